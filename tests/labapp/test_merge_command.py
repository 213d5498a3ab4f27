"""`labapp merge` on files of numpy's own generator, and on the record of a run."""

import json
import re
from html import unescape

import cv2
import h5py
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from labapp.cli import app
from labapp.common.errors import UserError
from optics.accuracy import MachineSpeed
from optics.camera import Sensor
from optics.hdr import Bracket, merge_seconds

pytestmark = pytest.mark.usefixtures("white_sheets")

TIMES = (1e-3, 4e-3, 16e-3)
NOISE = ["--gain", "2.6", "--read-noise", "2.4", "--black", "64", "--full-scale", "4095"]


def frame(rate, time, seed):
    rng = np.random.default_rng(seed)
    number = (rng.poisson(rate * time) + rng.normal(0, 2.4, rate.shape)) / 2.6 + 64
    return np.clip(np.round(number), 0, 4095).astype(np.uint16)


@pytest.fixture
def scene():
    return 10 ** np.random.default_rng(1).uniform(3, 6.5, (60, 80))


@pytest.fixture
def files(scene, tmp_path):
    paths = [tmp_path / f"{number}.tiff" for number in range(3)]
    for number, (path, time) in enumerate(zip(paths, TIMES, strict=True)):
        tifffile.imwrite(path, frame(scene, time, number))
    return paths


def merged(arguments):
    """What the command prints as JSON."""
    done = CliRunner().invoke(app, ["merge", *map(str, arguments), "--json"])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.mark.usefixtures("drawn")
def test_files_become_light_with_variance_state_and_a_report(files, scene, tmp_path):
    out = tmp_path / "merged.h5"
    said = merged([*files, "--exposures", "0.001,0.004,0.016", *NOISE, "--out", out])
    with h5py.File(out) as file:
        rate, variance, state = (file[name][:] for name in ("rate", "variance", "state"))
        assert json.loads(file["description"][()])["method"] == "full"
    valid = state == 0
    assert valid.mean() > 0.9
    assert np.mean((rate - scene)[valid] ** 2 / variance[valid]) == pytest.approx(1, abs=0.1)
    assert np.array_equal(tifffile.imread(tmp_path / "merged.tiff"), rate)
    assert cv2.imread(str(tmp_path / "merged.png")).shape == (60, 80, 3)
    page = (tmp_path / "merged.html").read_text()
    assert "0.tiff" in page
    assert "measured" in page
    assert said["sensor"]["source"] == "--gain, --read-noise, --black, --full-scale"
    assert 'read noise</td><td class="number">2.4 electrons<' in page
    assert said["warnings"] == []
    assert min(said["accuracy"]["efficiency"]) > 0.85


def test_a_wrong_exposure_is_named_and_corrected(scene, tmp_path):
    paths = [tmp_path / f"{number}.png" for number in range(3)]
    for number, (path, time) in enumerate(zip(paths, (1e-3, 4.4e-3, 16e-3), strict=True)):
        cv2.imwrite(str(path), frame(scene, time, number))
    arguments = [*paths, "--exposures", "0.001,0.004,0.016", *NOISE, "--out", tmp_path / "m.h5"]
    said = merged(arguments)
    assert said["factors"] == pytest.approx([1, 1.1, 1], abs=0.01)
    (words,) = said["warnings"]
    assert words.startswith("frame 2 has 1.1 times the light")
    trusted = merged([*arguments, "--as-given", "--force"])
    assert trusted["factors"] is None
    assert trusted["states"]["MOVED"] > 10 * said["states"]["MOVED"]


def test_dark_frames_are_subtracted(scene, tmp_path):
    paths, darks = [], []
    for number, time in enumerate(TIMES):
        for kind, light, seed in (("light", scene, number), ("dark", 0 * scene, 9 + number)):
            path = tmp_path / f"{kind}{number}.tiff"
            # A level of its own for each exposure.
            tifffile.imwrite(path, frame(light, time, seed) + 10 * number)
            (paths if kind == "light" else darks).append(path)
    options = [part for path in darks for part in ("--dark", path)]
    times = ["--exposures", "0.001,0.004,0.016"]
    merged([*paths, *times, *options, *NOISE, "--out", tmp_path / "m.h5"])
    with h5py.File(tmp_path / "m.h5") as file:
        rate = file["rate"][:]
    assert np.median(rate / scene) == pytest.approx(1, abs=0.01)


def test_colours_are_merged_each_by_itself(tmp_path):
    rate = 10 ** np.random.default_rng(2).uniform(3, 6, (30, 40, 3))
    paths = [tmp_path / f"{number}.tiff" for number in range(2)]
    for number, path in enumerate(paths):
        tifffile.imwrite(path, frame(rate, TIMES[number], number), photometric="rgb")
    merged([*paths, "--exposures", "0.001,0.004", *NOISE, "--out", tmp_path / "m.h5"])
    with h5py.File(tmp_path / "m.h5") as file:
        assert file["rate"].shape == (3, 30, 40)
        bright = rate[..., 1] > 1e5
        assert np.median(file["rate"][1][bright] / rate[..., 1][bright]) == pytest.approx(
            1, abs=0.01
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--exposures", "0.001,0.004"], "2 times for 3 files"),
        (["--exposures", "0.001,x,0.1"], "are seconds with commas"),
        (["--exposures", "0.01,0.02,-1"], "must be positive"),
        ([], "--exposures is missing"),
        (["--exposures", "0.001,0.004,0.016", "--method", "best"], "choose one of plain"),
        (["--exposures", "0.001,0.004,0.016", "--target", "star"], "of a record only"),
        (["--exposures", "0.001,0.004,0.016", "--gain", "-1"], "gain is -1"),
    ],
)
def test_what_does_not_fit_is_refused(files, tmp_path, options, words):
    with pytest.raises(UserError, match=words):
        merged([*files, *NOISE, *options, "--out", tmp_path / "m.h5"])
    assert not (tmp_path / "m.h5").exists()


def test_exposures_of_one_length_are_averaged_and_named(scene, tmp_path):
    paths = [tmp_path / f"{number}.tiff" for number in range(4)]
    for number, path in enumerate(paths):
        tifffile.imwrite(path, frame(scene, 1e-3, number))
    said = merged(
        [*paths, "--exposures", "0.001,0.001,0.001,0.001", *NOISE, "--out", tmp_path / "m.h5"]
    )
    assert any("all exposures are 0.001 s: the light is their mean" in one
               for one in said["warnings"])  # fmt: skip
    with h5py.File(tmp_path / "m.h5") as file:
        rate, variance, state = (file[name][:] for name in ("rate", "variance", "state"))
    assert np.mean((rate - scene)[state == 0] ** 2 / variance[state == 0]) == pytest.approx(
        1, abs=0.1
    )
    # A fourth of one frame's variance: photons, reading and rounding.
    light = scene * 1e-3
    wanted = (light + 2.4**2 + 2.6**2 / 12) / 4e-6
    bright = (light > 100) & (state == 0)
    assert variance[bright] == pytest.approx(wanted[bright], rel=0.25)


def test_numbers_that_end_below_the_full_scale_are_named(tmp_path):
    rate = 10 ** np.random.default_rng(1).uniform(3, 7, (60, 80))
    paths = [tmp_path / f"{number}.tiff" for number in range(3)]
    for number, (path, time) in enumerate(zip(paths, TIMES, strict=True)):
        tifffile.imwrite(path, frame(rate, time, number))
    arguments = [*paths, "--exposures", "0.001,0.004,0.016", *NOISE[:6], "--out", tmp_path / "m.h5"]
    assert any("Give --full-scale 4095" in one for one in merged(arguments)["warnings"])
    said = merged([*arguments, "--full-scale", "4095", "--force"])
    assert said["warnings"] == []


def test_unknown_noise_and_other_sizes_are_refused(files, tmp_path):
    times = ["--exposures", "0.001,0.004,0.016"]
    with pytest.raises(UserError, match="give --sensor FILE, or --gain"):
        merged([*files, *times, "--out", tmp_path / "m.h5"])
    tifffile.imwrite(files[1], np.zeros((10, 10), np.uint16))
    with pytest.raises(UserError, match="10 x 10 pixels"):
        merged([*files, *times, *NOISE, "--out", tmp_path / "m.h5"])
    with pytest.raises(UserError, match=r"must end in \.h5"):
        merged([*files, *times, *NOISE, "--out", tmp_path / "m.tiff"])
    with pytest.raises(UserError, match="is a file that is read"):
        merged([*files, *times, *NOISE, "--out", tmp_path / "0.h5"])


@pytest.mark.usefixtures("drawn")
def test_8_bit_pictures_are_merged_by_the_response_curve_that_they_show(tmp_path):
    """A gamma of 2.2 and a constant: neither sRGB's nor linear."""
    rng = np.random.default_rng(4)
    light = 10 ** (np.linspace(0.3, 3, 120)[:, None] + 0.2 * np.sin(np.arange(160) / 7))
    paths = [tmp_path / f"{number}.png" for number in range(4)]
    for path, time in zip(paths, (1e-3, 4e-3, 16e-3, 64e-3), strict=True):
        number = 10 + 245 * np.minimum(light * time / 2, 1) ** (1 / 2.2)
        seen = np.clip(np.round(number + rng.normal(0, 0.5, light.shape)), 0, 255)
        cv2.imwrite(str(path), cv2.merge([seen.astype(np.uint8)] * 3))
    times = ["--exposures", "0.001,0.004,0.016,0.064"]
    said = merged([*paths, *times, "--out", tmp_path / "m.h5"])
    (words,) = said["warnings"]
    assert "was measured on them" in words
    assert len(said["response"]) == 3
    with h5py.File(tmp_path / "m.h5") as file:
        ratio = np.log2(file["rate"][1] / light)[file["state"][1] == 0]
        assert file["rate"].attrs["unit"].startswith("light per second")
    assert ratio.size > 0.8 * light.size
    assert ratio.std() < 0.05
    assert "Response curve" in (tmp_path / "m.html").read_text()
    # What is said of numbers and noise counts.
    told = merged(
        [*paths, *times, "--encoding", "srgb", *NOISE[:4], "--out", tmp_path / "m.h5", "--force"]
    )
    assert told["sensor"]["gain_electrons_per_dn"] == 2.6
    with pytest.raises(UserError, match="frames of two exposure times at least"):
        merged([paths[0], "--exposures", "0.001", "--out", tmp_path / "x.h5"])


def test_a_budget_chooses_the_method_and_its_accuracy_is_said(files, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "labapp.pictures.merging.merge_command.machine_speed", lambda: MachineSpeed()
    )
    arguments = [*files, "--exposures", "0.001,0.004,0.016", *NOISE, "--out", tmp_path / "m.h5"]
    assert merged([*arguments, "--budget", "10"])["method"] == "full"
    bracket = Bracket([np.zeros((60, 80))] * 3, TIMES, [64.0] * 3, [1] * 3, Sensor())
    spent = 1.01 * merge_seconds(bracket, "Granados", MachineSpeed())
    assert merged([*arguments, "--budget", spent, "--force"])["method"] == "Granados"
    assert "method Granados, by simulation: its efficiency" in (tmp_path / "m.html").read_text()
    with pytest.raises(UserError, match=r"--budget 1e-09: .*takes .* s at least"):
        merged([*arguments, "--budget", "1e-9", "--force"])
    with pytest.raises(UserError, match="give one of them"):
        merged([*arguments, "--budget", "1", "--method", "full", "--force"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda frames: [np.full_like(one, 4095) for one in frames], "clipped in all .* shorter"),
        (lambda frames: [np.full_like(one, 64) for one in frames], "dark in all .* longer"),
        (lambda frames: [np.full_like(one, 20) for one in frames], "darker than without light"),
        (lambda frames: [frames[1], frames[0], frames[2]], "1 and 2 look exchanged"),
        (lambda frames: frames[::-1], "1 and 3 look exchanged"),
    ],
)
@pytest.mark.usefixtures("drawn")
def test_what_is_wrong_with_a_whole_bracket_is_said(scene, tmp_path, change, words):
    paths = [tmp_path / f"{number}.tiff" for number in range(3)]
    frames = change([frame(scene, time, number) for number, time in enumerate(TIMES)])
    for path, one in zip(paths, frames, strict=True):
        tifffile.imwrite(path, one)
    times = ["--exposures", "0.001,0.004,0.016"]
    said = merged([*paths, *times, *NOISE, "--out", tmp_path / "m.h5"])
    assert any(re.search(words, one) for one in said["warnings"])


def test_a_dark_frame_that_saw_light_is_named(scene, files, tmp_path):
    """Pixels become negative where they're subtracted."""
    for number, time in enumerate(TIMES):
        tifffile.imwrite(tmp_path / f"dark{number}.tiff", frame(0.3 * scene[::-1], time, 9))
    darks = [part for k in range(3) for part in ("--dark", tmp_path / f"dark{k}.tiff")]
    times = ["--exposures", "0.001,0.004,0.016"]
    said = merged([*files, *times, *darks, *NOISE, "--out", tmp_path / "m.h5"])
    assert any("darker than without light: the black level or the dark frames" in one
               for one in said["warnings"])  # fmt: skip
    with h5py.File(tmp_path / "m.h5") as file:
        assert not np.isnan(file["rate"][:]).any()
        assert not np.isnan(file["variance"][:]).any()


def test_negative_light_of_noise_is_kept_and_numbers_that_cut_it_are_named(tmp_path):
    dark = np.zeros((60, 80))
    for level, is_cut in ((64, False), (0, True)):
        paths = [tmp_path / f"{level}-{number}.tiff" for number in range(3)]
        for number, path in enumerate(paths):
            rng = np.random.default_rng(number)
            read = np.round(rng.normal(level, 2.4 / 2.6, dark.shape))
            tifffile.imwrite(path, np.maximum(read, 0).astype(np.uint16))
        said = merged(
            [*paths, "--exposures", "0.001,0.004,0.016", *NOISE[:4], "--black", level,
             "--full-scale", "4095", "--out", tmp_path / f"{level}.h5"]
        )  # fmt: skip
        assert any("cuts the noise of dark pixels" in one for one in said["warnings"]) == is_cut
        with h5py.File(tmp_path / f"{level}.h5") as file:
            rate, variance = file["rate"][:], file["variance"][:]
        mean = rate.mean() / np.sqrt(variance.mean() / rate.size)
        assert (abs(mean) > 10) == is_cut
        assert (rate < 0).any() != is_cut


@pytest.mark.parametrize("number", [0, 4095])
@pytest.mark.usefixtures("drawn")
def test_a_single_frame_without_any_light_or_dark_is_merged_and_named(tmp_path, number):
    tifffile.imwrite(tmp_path / "one.tiff", np.full((20, 30), number, np.uint16))
    said = merged(
        [tmp_path / "one.tiff", "--exposures", "0.01", *NOISE, "--out", tmp_path / "m.h5"]
    )
    assert said["states"]["CLIPPED" if number else "DARK"] == 1
    words = "add shorter ones" if number else "darker than without light"
    assert any(words in one for one in said["warnings"])
    with h5py.File(tmp_path / "m.h5") as file:
        assert not np.isnan(file["rate"][:]).any()


def test_8_bit_frames_that_are_exchanged_clipped_or_dark_are_refused_with_the_remedy(tmp_path):
    light = 10 ** np.linspace(0.3, 3, 120)[:, None] * np.ones((1, 160))
    times, paths = (1e-3, 4e-3, 16e-3, 64e-3), [tmp_path / f"{k}.png" for k in range(4)]
    shown = [10 + 245 * np.minimum(light * time / 2, 1) ** (1 / 2.2) for time in times]
    for order, words in (
        ([2, 1, 0, 3], r"0\.png, 2\.png: frames 1 and 3 look exchanged"),
        ([3, 2, 1, 0], r"frames 1, 2, 3, 4 don't get brighter with their exposure times"),
    ):
        for path, number in zip(paths, order, strict=True):
            cv2.imwrite(str(path), np.round(shown[number]).astype(np.uint8))
        with pytest.raises(UserError, match=words):
            merged([*paths, "--exposures", "0.001,0.004,0.016,0.064", "--out", tmp_path / "m.h5"])
    for number, words in ((255, "add shorter exposures"), (0, "add longer exposures")):
        for path in paths:
            cv2.imwrite(str(path), np.full((40, 50), number, np.uint8))
        with pytest.raises(UserError, match=words):
            merged([*paths, "--exposures", "0.001,0.004,0.016,0.064", "--out", tmp_path / "m.h5"])


def test_a_frame_that_shares_no_pixels_with_others_has_no_factor(tmp_path):
    """Two frames are white: their times can't be told, and JSON says null."""
    rate = 10 ** np.random.default_rng(1).uniform(6.2, 6.8, (60, 80))
    times = (1e-3, 2e-3, 1.0, 2.0)
    paths = [tmp_path / f"{number}.tiff" for number in range(4)]
    for number, (path, time) in enumerate(zip(paths, times, strict=True)):
        tifffile.imwrite(path, frame(rate, time, number))
    said = merged([*paths, "--exposures", "0.001,0.002,1,2", *NOISE, "--out", tmp_path / "m.h5"])
    assert said["factor_deviations"][2:] == [None, None]
    assert max(said["factor_deviations"][:2]) < 0.01
    assert "can't be told" in unescape((tmp_path / "m.html").read_text())


def test_the_darkness_around_a_star_is_no_fault(tmp_path):
    rate = np.full((60, 80), 10.0)
    rate[30, 40] = 1e6
    paths = [tmp_path / f"{number}.tiff" for number in range(3)]
    for number, (path, time) in enumerate(zip(paths, TIMES, strict=True)):
        tifffile.imwrite(path, frame(rate, time, number))
    times = ["--exposures", "0.001,0.004,0.016"]
    said = merged([*paths, *times, *NOISE, "--out", tmp_path / "m.h5"])
    assert said["states"]["DARK"] > 0.99
    assert not any("add longer ones" in one for one in said["warnings"])


def test_files_that_are_no_frames_of_one_sensor_are_refused(files, tmp_path):
    arguments = ["--exposures", "0.001,0.004,0.016", *NOISE, "--out", tmp_path / "m.h5"]
    good = tifffile.imread(files[1])
    for wrong, words in (
        ((good >> 4).astype(np.uint8), r"1\.tiff: has uint8 numbers and .* uint16 ones"),
        ((good / 4095).astype(np.float32), r"1\.tiff: has float32 numbers"),
        (np.stack([good] * 3, axis=-1), r"1\.tiff: .* in 3 colours"),
    ):
        kind = "rgb" if wrong.ndim == 3 else "minisblack"
        tifffile.imwrite(files[1], wrong, photometric=kind)
        with pytest.raises(UserError, match=words):
            merged([*files, *arguments])
    files[1].write_bytes(files[0].read_bytes()[:3000])
    with pytest.raises(UserError, match=r"1\.tiff: is a TIFF that is cut short"):
        merged([*files, *arguments])
    for change, words in (
        (lambda one: np.where(one > 200, np.nan, one), "numbers that are NaN"),
        (lambda one: one / 4095, "not shares of them"),
    ):
        for path in files:
            tifffile.imwrite(path, change(good).astype(np.float32))
        with pytest.raises(UserError, match=words):
            merged([*files, *arguments])
