"""Photographs behind a trained pattern, decoded by `labapp reconstruct --decoder`."""

from __future__ import annotations

import functools
import json
from dataclasses import replace
from typing import Any

import cv2
import h5py
import numpy as np
import pytest
import tifffile
import torch
from small_bench.files import write_small
from small_bench.trained import SHAPE, WAVELENGTH, pattern_levels, write_trained

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.edof import decoding
from labapp.edof.shown_pattern import match_shown_pattern
from labapp.edof.trained_pattern import TrainedPattern, read_trained_pattern
from labapp.files import design_file
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.pictures.reconstructing.decoding import average_squares, fill_gaps
from labapp.runs.acquisition.runner import run_plan
from optics.edof.decoders import extend_antisymmetrically
from optics.edof.dioptres import midpoint_dioptres
from optics.edof.learned import DecoderSettings
from optics.edof.picture_spectrum import NATURAL_SPECTRUM, FrequencyGrid
from optics.edof.protocol import EdofProtocol
from optics.edof.protocol_psfs import DepthPSFs, PupilPattern, compute_depth_psfs

pytestmark = pytest.mark.usefixtures("white_sheets")

DEPTHS = 2


_kept_psfs: dict[Any, DepthPSFs] = {}


@functools.cache
def spectrum(side: int) -> torch.Tensor:
    return NATURAL_SPECTRUM.on_grid(FrequencyGrid(side))


@pytest.fixture(autouse=True)
def quick_filters(monkeypatch):
    """Filters of two depths, which take a tenth of the time of 32; PSFs are computed once."""

    def psfs(shown, dioptres, camera, protocol, source=None):
        key = (shown.phase.numpy().tobytes(), tuple(dioptres), camera, protocol)
        if key not in _kept_psfs:
            _kept_psfs[key] = compute_depth_psfs(shown, dioptres, camera, protocol)
        return _kept_psfs[key]

    monkeypatch.setattr(decoding, "_DEPTHS", DEPTHS)
    monkeypatch.setattr(decoding, "compute_depth_psfs", psfs)
    monkeypatch.setattr(TrainedPattern, "spectrum_on_grid", lambda _, side: spectrum(side))


@pytest.fixture
def trained(tiny, tmp_path):
    """A design file whose network adds nothing to the filter's picture."""
    return write_trained(tmp_path / "filter.h5", tiny.bench)


@pytest.fixture
def refining(tiny, tmp_path):
    """A design file whose network changes the filter's picture."""
    return write_trained(tmp_path / "network.h5", tiny.bench, seed=1)


def picture(shape=(40, 45), seed=0) -> np.ndarray:
    """Smooth and bright, with noise."""
    rng = np.random.default_rng(seed)
    smooth = cv2.GaussianBlur(rng.random(shape), (0, 0), 3)
    return (0.2 + smooth / smooth.max() + rng.normal(0, 0.01, shape)).astype(np.float32)


def decode(labapp, source, decoder, *options) -> tuple[dict, np.ndarray]:
    """What the command tells, and the picture that it writes."""
    out = source.with_name(f"{source.stem}-decoded.npy")
    words = ("--decoder", decoder, "--out", out, "--force", "--json")
    code, printed, errors = labapp("reconstruct", source, *words, *options)
    assert code == 0, errors
    return json.loads(printed), np.load(out)


def refused(labapp, *words) -> str:
    code, _, errors = labapp("reconstruct", *words)
    assert code != 0
    return " ".join(errors.split())


def test_without_a_network_the_picture_is_that_of_a_wiener_filter(labapp, trained, tmp_path):
    """The formula in NumPy, over PSFs and a border that the engine's own tests judge."""
    capture = picture((41, 46))
    np.save(tmp_path / "capture.npy", capture)
    told, found = decode(labapp, tmp_path / "capture.npy", trained, "--noise", "0.01")
    pattern = read_trained_pattern(trained)
    protocol = EdofProtocol("test", wavelength=WAVELENGTH, pixel_pitch=pattern.camera.sensor.pitch)
    shown = PupilPattern("tiny", pattern.phase)
    depths = midpoint_dioptres(DEPTHS, (0.0, 2.0))
    kernels = compute_depth_psfs(shown, depths, pattern.camera, protocol).kernels.double().numpy()
    side = 1024
    first = side // 2 - kernels.shape[1] // 2
    grid = np.zeros((DEPTHS, side, side))
    grid[:, first : first + kernels.shape[1], first : first + kernels.shape[2]] = kernels
    transfer = np.fft.rfft2(np.fft.ifftshift(grid, (1, 2)))
    light = spectrum(side).double().numpy()
    noise = 0.01 / told["white"]
    power = (np.abs(transfer) ** 2).mean(0)
    response = light * transfer.mean(0).conj() / (light * power + noise**2)
    response[0, 0] = 1 / transfer.mean(0)[0, 0]
    kernel = np.fft.fftshift(np.fft.irfft2(response, (side, side)))
    scaled = torch.from_numpy(capture / np.float32(told["white"]))
    rows, columns = 80, 92  # Twice the sides, less 2 where that is a fast length.
    whole = extend_antisymmetrically(scaled, (rows, columns), noise).double().numpy()
    # The kernel is wider than the extension's period, in which it wraps around.
    wrapped = np.zeros((rows, columns))
    y, x = (np.arange(side) - side // 2) % rows, (np.arange(side) - side // 2) % columns
    np.add.at(wrapped, (y[:, None], x[None]), kernel)
    filtered = np.fft.irfft2(np.fft.rfft2(whole) * np.fft.rfft2(wrapped), (rows, columns))
    top, left = rows // 2 - 41 // 2, columns // 2 - 46 // 2
    expected = told["white"] * filtered[top : top + 41, left : left + 46]
    assert found.shape == capture.shape
    assert np.abs(found - expected).max() < 1e-3 * np.ptp(expected)


@pytest.mark.usefixtures("drawn")
def test_the_command_says_what_the_decoder_is(labapp, refining, tmp_path):
    np.save(tmp_path / "capture.npy", picture())
    np.save(tmp_path / "truth.npy", picture())
    words = (tmp_path / "capture.npy", "--decoder", refining, "--truth", tmp_path / "truth.npy")
    code, printed, errors = labapp("reconstruct", *words)
    assert code == 0, errors
    said = " ".join(printed.split())
    weights = sum(one.numel() for one in read_trained_pattern(refining).network.parameters())
    for text in (
        "blind",
        f"{weights} weights",
        "drawn pictures",
        "0 to 2 dioptres",
        "PSNR",
        "SSIM",
    ):
        assert text in said
    assert tifffile.imread(tmp_path / "capture_decoded.tiff").dtype == np.float32
    drawn = cv2.imread(str(tmp_path / "capture_decoded_before_after.png"))
    assert drawn.std() > 10


def test_a_decoder_that_is_blind_gives_each_capture_its_own_picture(labapp, refining, tmp_path):
    """Whatever was decoded before: the same bits."""
    for name in "ab":
        np.save(tmp_path / f"{name}.npy", picture(seed=ord(name)))
    first = {name: decode(labapp, tmp_path / f"{name}.npy", refining)[1] for name in "ab"}
    second = {name: decode(labapp, tmp_path / f"{name}.npy", refining)[1] for name in "ba"}
    assert not np.array_equal(first["a"], first["b"])
    for name in "ab":
        assert np.array_equal(first[name], second[name])


def test_the_picture_doesnt_depend_on_its_unit(labapp, refining, tmp_path):
    np.save(tmp_path / "a.npy", picture())
    np.save(tmp_path / "b.npy", 1024 * picture())
    (one, small), (other, large) = (decode(labapp, tmp_path / f"{n}.npy", refining) for n in "ab")
    assert np.allclose(1024 * small, large, rtol=1e-4, atol=0.05)
    assert 1024 * one["noise"] == pytest.approx(other["noise"], rel=1e-3)


def test_16_bit_levels_and_equal_colours_are_decoded_as_light(labapp, refining, tmp_path):
    light = picture()
    levels = np.rint(20000 * light).astype(np.uint16)
    np.save(tmp_path / "light.npy", 20000 * light)
    cv2.imwrite(str(tmp_path / "grey.png"), levels)
    cv2.imwrite(str(tmp_path / "colour.tiff"), np.stack([levels] * 3, -1))
    _, expected = decode(labapp, tmp_path / "light.npy", refining)
    for name in ("grey.png", "colour.tiff"):
        _, found = decode(labapp, tmp_path / name, refining)
        assert np.abs(found - expected).max() < 20


def test_different_colours_are_refused_or_averaged(labapp, refining, tmp_path):
    bands = np.stack([picture(), 0.5 * picture(seed=1), picture(seed=2)], -1)
    np.save(tmp_path / "colour.npy", bands)
    np.save(tmp_path / "mean.npy", bands.mean(-1))
    said = refused(labapp, tmp_path / "colour.npy", "--decoder", refining)
    assert "3 different bands" in said
    assert "--grey" in said
    _, found = decode(labapp, tmp_path / "colour.npy", refining, "--grey")
    _, expected = decode(labapp, tmp_path / "mean.npy", refining)
    assert np.allclose(found, expected, atol=1e-5)


@pytest.mark.usefixtures("drawn")
def test_clipped_and_dead_pixels_are_filled_and_counted(labapp, refining, tmp_path):
    whole = picture()
    broken = whole.copy()
    broken[10, 20] = broken[30:32, 8] = np.nan
    broken[20, 5:10] = 2.0
    np.save(tmp_path / "whole.npy", whole)
    np.save(tmp_path / "broken.npy", broken)
    _, expected = decode(labapp, tmp_path / "whole.npy", refining, "--noise", "0.01")
    told, found = decode(
        labapp, tmp_path / "broken.npy", refining, "--noise", "0.01", "--clip", "1.9"
    )
    assert told["dead_pixels"] == 3
    assert told["clipped_pixels"] == 5
    assert any("5 clipped" in one for one in told["notes"])
    assert any("3 dead" in one for one in told["notes"])
    assert np.isfinite(found).all()
    np.save(tmp_path / "dead.npy", np.where(np.isnan(broken), np.nan, whole))
    _, dead = decode(labapp, tmp_path / "dead.npy", refining, "--noise", "0.01")
    # What three pixels of smooth light were is known to about the noise.
    assert np.abs(dead - expected).max() < 0.1


def test_gaps_are_filled_from_sound_pixels_alone():
    y, x = np.mgrid[:20, :30].astype(np.float32)
    light = 1 + 0.1 * y + 0.2 * x
    broken = light.copy()
    broken[7, 8] = broken[0, 0] = np.nan
    broken[10:20, 12:28] = np.nan
    filled = fill_gaps(broken)
    sound = np.isfinite(broken)
    assert np.array_equal(filled[sound], light[sound])
    assert filled[7, 8] == pytest.approx(light[7, 8], abs=1e-5)
    assert np.isfinite(filled).all()
    assert light.min() <= filled.min()
    assert filled.max() <= light.max()
    with pytest.raises(UserError, match="no sound pixel"):
        fill_gaps(np.full((3, 3), np.nan, np.float32))


def test_squares_are_averaged_over_their_sound_pixels():
    light = np.arange(35, dtype=np.float32).reshape(1, 5, 7)
    light[0, 0, 0] = np.nan
    light[0, 2:4, 2:4] = np.nan
    found = average_squares(light, 2)
    assert found.shape == (1, 2, 3)
    assert found[0, 0, 0] == pytest.approx((1 + 7 + 8) / 3)
    assert found[0, 1, 0] == pytest.approx((14 + 15 + 21 + 22) / 4)
    assert np.isnan(found[0, 1, 1])
    with pytest.raises(UserError, match="averages 6 x 6"):
        average_squares(light, 6)


def test_a_decoder_of_averaged_pixels_averages_the_photograph_and_its_truth(labapp, tiny, tmp_path):
    decoder = write_trained(tmp_path / "two.h5", tiny.bench, scenes={"binning": 2})
    np.save(tmp_path / "capture.npy", picture((41, 47)))
    np.save(tmp_path / "truth.npy", picture((41, 47)))
    told, found = decode(
        labapp, tmp_path / "capture.npy", decoder, "--truth", tmp_path / "truth.npy"
    )
    assert found.shape == (20, 23)
    assert told["score"]["psnr_db"][0] is None or told["score"]["psnr_db"][0] > 60
    assert told["decoder"]["binning"] == 2


# What doesn't belong together.


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--psf", "capture.npy"), ("--blind", "15"), ("--method", "tv"), ("--budget", "1"),
        ("--weight", "1"), ("--refine-psf", None), ("--border", "dark"), ("--star", "star"),
        ("--bands", "all"), ("--white", "flat"),
    ],
)  # fmt: skip
def test_options_that_mean_nothing_with_a_decoder_are_refused(labapp, tmp_path, option, value):
    np.save(tmp_path / "capture.npy", picture())
    value = tmp_path / value if option == "--psf" else value
    words = [option] if value is None else [option, value]
    said = refused(labapp, tmp_path / "capture.npy", "--decoder", "edof", *words)
    assert option in said
    assert "out" in said


def test_files_that_are_no_decoder_are_refused_in_words(labapp, tiny, trained, tmp_path):
    np.save(tmp_path / "capture.npy", picture())
    (tmp_path / "foreign.h5").write_bytes(b"no HDF5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = 1
    write_trained(tmp_path / "bare.h5", tiny.bench, has_decoder=False)
    told = DecoderSettings(SHAPE, front="known")
    write_trained(tmp_path / "told.h5", tiny.bench, settings=told)
    with h5py.File(write_trained(tmp_path / "damaged.h5", tiny.bench), "a") as file:
        weights = file["entry/decoder/weights"]
        del weights[next(iter(weights))]
    for name, words in {
        "nowhere.h5": "there is no such file",
        "foreign.h5": "cannot be read as HDF5",
        "other.h5": "is no design file",
        "bare.h5": "labapp train edof",
        "told.h5": "told the depth",
        "damaged.h5": "its decoder is damaged",
    }.items():
        said = refused(labapp, tmp_path / "capture.npy", "--decoder", tmp_path / name)
        assert name in said
        assert words in said


def test_pictures_that_cant_be_decoded_are_refused_in_words(labapp, trained, tmp_path):
    np.save(tmp_path / "dark.npy", np.zeros((40, 45), np.float32))
    np.save(tmp_path / "capture.npy", picture())
    np.save(tmp_path / "truth.npy", picture((20, 20)))
    capture, decoder = tmp_path / "capture.npy", ("--decoder", trained)
    assert "dark" in refused(labapp, tmp_path / "dark.npy", *decoder)
    assert "same unit" in refused(labapp, capture, *decoder, "--noise", "5")
    assert "it must be" in refused(labapp, capture, *decoder, "--truth", tmp_path / "truth.npy")
    assert "is no record" in refused(labapp, capture, *decoder, "--target", "star")
    assert "is a file that is read" in refused(labapp, capture, *decoder, "--out", capture)


# Records.


@pytest.fixture
def record(tiny, refining, tmp_path):
    return take_record(tiny, refining, tmp_path / "run.h5", 8)


def take_record(tiny, refining, path, exposure_ms):
    """A photograph through the pattern, through another one, and through none."""
    plan = read_file(tiny.plan, PlanFile).model_dump()
    plan["patterns"] = {
        "neutral": {"kind": "constant"},
        "trained": {"kind": "image", "file": str(refining)},
        "lens": {"kind": "lens", "focal_length_m": 50.0},
    }
    block = {"patterns": ["neutral"], "wavelengths_nm": [550], "exposures_ms": [exposure_ms]}
    plan["acquire"] = [
        {"targets": ["dark"], **block},
        {"targets": ["photograph"], **block, "patterns": ["neutral", "lens", "trained"]},
    ]
    with open_bench(tiny.bench_files) as bench:
        return run_plan(bench, PlanFile.model_validate(plan), path).path


def test_clipped_pixels_of_a_record_count_as_full_wells(labapp, tiny, refining, tmp_path):
    record = take_record(tiny, refining, tmp_path / "bright.h5", 12_000)
    told, found = decode(labapp, record, refining)
    assert np.isfinite(found).all()
    assert 0 < told["clipped_pixels"] < 40 * 45
    # Light of a full well, in electrons per second: no clipped pixel counts as dark.
    assert told["white"] > 10500 / 12
    record = take_record(tiny, refining, tmp_path / "brighter.h5", 20_000)
    assert "Expose shorter" in refused(labapp, record, "--decoder", refining)


def test_a_record_is_decoded_if_its_pattern_is_the_decoders(labapp, record, refining):
    told, found = decode(labapp, record, refining)
    assert told["strehl"] == pytest.approx(1.0)
    assert told["blind"] is True
    assert told["source"].endswith("photograph, trained, 550 nm")
    assert "neutral photograph" in told["score"]["against"]
    assert any("sharp at the lens' focus alone" in one for one in told["notes"])
    assert found.shape == (40, 45)
    assert not told["noise_told"]
    said = refused(labapp, record, "--decoder", refining, "--pattern", "lens")
    assert "its pattern 'lens': isn't the pattern of the decoder" in said
    assert str(refining) in said
    assert "--decoder FILE" in said
    said = refused(labapp, record, "--decoder", refining, "--clip", "5")
    assert "is a record" in said


def test_phases_are_compared_and_not_grey_levels(trained):
    """On a panel of half the range twice the levels make the phase, and the same ones don't."""
    pattern = read_trained_pattern(trained)
    camera = pattern.camera
    halved = tuple((wave, phase / 2) for wave, phase in camera.panel.max_phase)
    other = replace(camera, panel=replace(camera.panel, max_phase=halved))
    grey = pattern.grey
    shown = match_shown_pattern(pattern, other, 2 * grey, WAVELENGTH, "photograph")
    assert shown.strehl == pytest.approx(1.0)
    assert not shown.same_levels
    assert shown.camera.panel == other.panel
    assert match_shown_pattern(pattern, camera, grey, WAVELENGTH, "it").same_levels
    with pytest.raises(UserError, match="this panel makes other phases"):
        match_shown_pattern(pattern, other, grey, WAVELENGTH, "photograph")
    with pytest.raises(UserError, match="isn't the pattern of the decoder"):
        match_shown_pattern(pattern, camera, pattern_levels(grey.shape, 5), WAVELENGTH, "it")
    with pytest.raises(UserError, match=r"at 520 nm.*for 550 nm"):
        match_shown_pattern(pattern, camera, grey, 520e-9, "photograph")
    with pytest.raises(UserError, match="video"):
        match_shown_pattern(pattern, camera, grey[None], WAVELENGTH, "photograph")
    coarse = replace(camera, panel=replace(camera.panel, pitch=9e-6))
    with pytest.raises(UserError, match=r"pixels of 9 µm.*labapp train edof"):
        match_shown_pattern(pattern, coarse, grey, WAVELENGTH, "photograph")


def test_a_decoder_of_another_camera_is_refused(labapp, tiny, record, refining, tmp_path):
    """The same panel before a lens of another focal length."""
    bench = tmp_path / "other.toml"
    text = tiny.bench.read_text()
    bench.write_text(text.replace("focal_length_mm = 125.0", "focal_length_mm = 200.0"))
    decoder = write_trained(tmp_path / "long.h5", bench)
    said = refused(labapp, record, "--decoder", decoder)
    assert "is for a lens of 200 mm" in said
    assert "125 mm" in said


# The bundled pattern as a kind of pattern.


@pytest.fixture
def bundled(trained, monkeypatch):
    monkeypatch.setattr(design_file, "bundled_trained_design", lambda: trained)
    return trained


def test_the_bundled_pattern_is_a_kind_of_pattern(labapp, tiny, bundled, tmp_path):
    out = tmp_path / "shown.png"
    words = ("pattern", "edof", "--bench", tiny.bench, "--out", out)
    code, _, errors = labapp(*words, "--wavelength-nm", "550")
    assert code == 0, errors
    assert np.array_equal(cv2.imread(str(out), 0), pattern_levels((48, 64)))
    code, _, errors = labapp(*words, "--wavelength-nm", "520", "--force")
    assert code != 0
    assert "made for 550 nm" in " ".join(errors.split())


def test_the_bundled_pattern_is_for_one_panel(labapp, bundled, tmp_path):
    small, out = write_small(tmp_path / "small"), tmp_path / "shown.png"
    words = ("--bench", small.bench, "--out", out, "--wavelength-nm", "550")
    code, _, errors = labapp("pattern", "edof", *words)
    assert code != 0
    assert "is for a panel of 64x48 pixels of 40 µm" in " ".join(errors.split())


def test_a_sensor_with_colour_filters_is_decoded_grey_or_refused(labapp, tiny, tmp_path):
    """Grey, its pixels are made one band before."""
    text = tiny.bench.read_text()
    first, last = text.index("[sensor]"), text.index("[devices.slm]")
    colour = '[sensor]\nfile = "dvc-4000c-like"\nwidth = 45\nheight = 40\n'
    tiny.bench.write_text(text[:first] + colour + "dead_pixels_ppm = 3000.0\n" + text[last:])
    decoder = write_trained(tmp_path / "colour.h5", tiny.bench, seed=1)
    record = take_record(tiny, decoder, tmp_path / "run.h5", 400)
    assert "--grey" in refused(labapp, record, "--decoder", decoder)
    told, found = decode(labapp, record, decoder, "--grey")
    assert found.shape == (40, 45)
    assert np.isfinite(found).all()
    assert told["strehl"] == pytest.approx(1.0)
