"""`labapp reconstruct`: pictures blurred by a direct convolution here, restored and judged here."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from scipy.signal import convolve2d
from skimage import data
from small_bench.files import write_small

from labapp.bench.opening import open_bench
from labapp.files.picture.photograph import read_photograph
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.runner import run_plan

pytestmark = pytest.mark.usefixtures("white_sheets")

SIDE = 120


def disk(radius):
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    inside = (x**2 + y**2 <= radius**2).astype(float)
    return inside / inside.sum()


def valid(scene, psf):
    """What a camera sees: the light that has come into the frame from beyond it included."""
    margin = psf.shape[0] // 2
    frame = convolve2d(scene, psf, mode="valid")
    return scene[margin:-margin, margin:-margin], frame


def noisy(frame, sigma, seed=0):
    return frame + np.random.default_rng(seed).normal(0, sigma, frame.shape)


def psnr(image, truth):
    return 10 * np.log10(1 / np.mean((image - truth) ** 2))


def linear(level):
    return np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)


def srgb(light):
    light = np.clip(light, 0, 1)
    level = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * level).astype(np.uint8)


def scene():
    return data.camera()[100 : 100 + SIDE, 140 : 140 + SIDE] / 255.0


@pytest.fixture
def grey(tmp_path):
    """A noisy frame as light, its PSF, and the truth, which is given back."""
    truth, frame = valid(scene(), disk(4))
    np.save(tmp_path / "frame.npy", noisy(frame, 0.005).astype(np.float32))
    np.save(tmp_path / "psf.npy", disk(4))
    np.save(tmp_path / "truth.npy", truth)
    return truth


def said(labapp, folder, *options, name="frame.npy", psf="psf.npy"):
    code, printed, errors = labapp(
        "reconstruct", folder / name, "--psf", folder / psf, *options, "--json"
    )
    assert code == 0, errors
    return json.loads(printed)


@pytest.mark.parametrize(
    ("method", "gain"),
    [("auto", 4), ("tv", 4), ("hyper-laplacian", 3.5), ("wiener", 2), ("richardson-lucy", 2)],
)
@pytest.mark.usefixtures("drawn")
def test_every_method_brings_a_blurred_picture_nearer_to_the_truth(
    labapp, grey, tmp_path, method, gain
):
    told = said(labapp, tmp_path, "--method", method, "--truth", tmp_path / "truth.npy")
    frame, answer = (
        np.load(tmp_path / "frame.npy"),
        tifffile.imread(tmp_path / "frame_restored.tiff"),
    )
    assert answer.dtype == np.float32
    before, after = psnr(frame, grey), psnr(answer, grey)
    assert after > before + gain
    assert told["score"]["psnr_db"] == pytest.approx([before, after], abs=0.01)
    assert told["score"]["peak"] == 1
    assert told["noise"][0] == pytest.approx(0.005, rel=0.3)
    assert told["residual"] < 1.3
    picture = cv2.imread(told["picture"])
    assert picture.shape[1] > 1000
    assert picture.std() > 10


def test_the_table_says_how_far_to_trust_it(labapp, grey, tmp_path):
    code, printed, _ = labapp("reconstruct", tmp_path / "frame.npy", "--psf", tmp_path / "psf.npy")
    assert code == 0
    for words in ("total variation", "estimated", "weight", "iterations", "good: what", "wrote"):
        assert words in printed


def test_a_noise_that_is_told_wrongly_is_named(labapp, grey, tmp_path):
    told = said(labapp, tmp_path, "--noise", "0.0015", "--method", "tv")
    assert told["noise"] == [0.0015]
    assert told["causes"] == ["noise"]
    assert "told as 0.0015, and the photograph shows 0.00" in told["verdict"]
    told = said(labapp, tmp_path, "--noise", "0.015", "--method", "tv", "--force")
    assert told["causes"] == ["noise"]
    assert "told as 0.015" in told["verdict"]


def test_clipped_pixels_that_nobody_marked_are_named(labapp, grey, tmp_path):
    frame = np.load(tmp_path / "frame.npy")
    level = float(np.quantile(frame, 0.98))
    np.save(tmp_path / "frame.npy", frame.clip(max=level))
    assert "clipping" in said(labapp, tmp_path, "--clip", "2")["causes"]
    assert "clipping" not in said(labapp, tmp_path, "--force")["causes"]


def test_a_psf_of_a_wrong_scale_is_named_with_its_sign_and_refined(labapp, grey, tmp_path):
    for size, words in ((4.25, "too large"), (3.75, "too small")):
        np.save(tmp_path / "psf.npy", disk(size))
        told = said(labapp, tmp_path, "--truth", tmp_path / "truth.npy", "--force")
        assert told["causes"][0] == "psf-scale"
        assert words in told["verdict"]
        assert told["psf_scale"][0] == pytest.approx(4 / size, abs=0.02)
        mended = said(
            labapp, tmp_path, "--refine-psf", "--truth", tmp_path / "truth.npy", "--force"
        )
        assert mended["psf_refined"]
        assert "psf-scale" not in mended["causes"]
        assert mended["score"]["psnr_db"][1] > told["score"]["psnr_db"][1] + 0.5


def test_a_right_psf_isnt_refined(labapp, grey, tmp_path):
    told = said(labapp, tmp_path, "--refine-psf")
    assert told["psf_scale"] == [1.0]
    assert not told["psf_refined"]
    assert told["causes"] == []


@pytest.mark.usefixtures("drawn")
def test_an_8_bit_colour_photograph_is_restored_as_light_band_by_band(labapp, tmp_path):
    light = linear(data.astronaut()[20 : 20 + SIDE, 160 : 160 + SIDE] / 255.0)
    pairs = [valid(light[..., band], disk(4)) for band in range(3)]
    truth, frame = (np.stack(one, -1) for one in zip(*pairs, strict=True))
    cv2.imwrite(str(tmp_path / "frame.png"), srgb(noisy(frame, 0.002))[..., ::-1])
    cv2.imwrite(str(tmp_path / "psf.png"), np.rint(255 * disk(4) / disk(4).max()).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "truth.png"), srgb(truth)[..., ::-1])
    told = said(
        labapp,
        tmp_path,
        "--truth",
        tmp_path / "truth.png",
        "--out",
        tmp_path / "after.png",
        name="frame.png",
        psf="psf.png",
    )
    after = linear(cv2.imread(str(tmp_path / "after.png"))[..., ::-1] / 255.0)
    assert after.shape == truth.shape
    assert psnr(after, truth) > psnr(frame, truth) + 4
    before, best = told["score"]["psnr_db"]
    assert best > before + 4
    assert len(told["noise"]) == 3
    assert told["unit"] == "of white"


def test_16_bit_levels_are_light_and_a_dark_level_is_subtracted(labapp, tmp_path):
    truth, frame = valid(scene(), disk(4))
    levels = np.rint(noisy(frame, 0.005) * 3000 + 200).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "frame.png"), levels)
    tifffile.imwrite(tmp_path / "psf.tiff", disk(4).astype(np.float32))
    told = said(
        labapp,
        tmp_path,
        "--dark",
        "200",
        "--out",
        tmp_path / "after.npy",
        name="frame.png",
        psf="psf.tiff",
    )
    after = np.load(tmp_path / "after.npy") / 3000
    assert psnr(after, truth) > psnr(frame, truth) + 4
    assert told["noise"][0] == pytest.approx(15, rel=0.3)


def test_full_wells_are_found_and_left_out(labapp, tmp_path):
    """Highlights of many times white, cut off at 4095: what is masked doesn't draw rings."""
    light = 0.5 * scene()
    rng = np.random.default_rng(3)
    for y, x in rng.integers(20, SIDE - 20, (6, 2)):
        light[y : y + 3, x : x + 3] = 12
    truth, frame = valid(light, disk(4))
    levels = np.rint(np.clip(noisy(frame, 0.003) * 4095, 0, 4095)).astype(np.uint16)
    np.save(tmp_path / "frame.npy", levels)
    np.save(tmp_path / "psf.npy", disk(4))
    assert read_photograph(tmp_path / "frame.npy").saturation_level() == 4095
    masked = said(labapp, tmp_path, "--out", tmp_path / "a.npy")
    plain = said(labapp, tmp_path, "--clip", "9999", "--out", tmp_path / "b.npy")
    assert masked["clipped_share"] == pytest.approx((levels == 4095).mean())
    assert plain["clipped_share"] == 0
    # What only full pixels have seen nobody knows; beside it there are no rings.
    beside = convolve2d(truth > 1, np.ones((17, 17)), mode="same") == 0
    a, b = (np.load(tmp_path / name)[beside] / 4095 for name in ("a.npy", "b.npy"))
    assert psnr(a, truth[beside]) > psnr(b, truth[beside]) + 3


def test_a_bright_picture_that_is_not_full_is_not_clipped(tmp_path):
    rng = np.random.default_rng(0)
    levels = np.clip(rng.normal(180, 20, (200, 200)), 0, 250).astype(np.uint8)
    levels[levels == levels.max()] -= 1
    cv2.imwrite(str(tmp_path / "a.png"), levels)
    assert read_photograph(tmp_path / "a.png").saturation_level() is None
    np.save(tmp_path / "even.npy", np.ones((9, 9)))
    assert read_photograph(tmp_path / "even.npy").saturation_level() is None


def test_dead_pixels_are_nan_and_restored_from_around(labapp, grey, tmp_path):
    frame = np.load(tmp_path / "frame.npy")
    dead = np.random.default_rng(1).random(frame.shape) < 0.02
    frame[dead] = np.nan
    np.save(tmp_path / "frame.npy", frame)
    told = said(labapp, tmp_path, "--out", tmp_path / "after.npy")
    after = np.load(tmp_path / "after.npy")
    assert np.isfinite(after).all()
    assert told["dead_share"] == pytest.approx(dead.mean())
    assert psnr(after, grey) > psnr(np.where(dead, grey, frame), grey) + 3


def test_a_budget_chooses_the_method(labapp, grey, tmp_path):
    code, _, errors = labapp(
        "reconstruct", tmp_path / "frame.npy", "--psf", tmp_path / "psf.npy", "--budget", "1e-6"
    )
    assert code == 1
    least = re.search(r"the quickest, wiener, takes about (\S+) s", errors)
    hurried = said(labapp, tmp_path, "--budget", least[1])
    patient = said(labapp, tmp_path, "--budget", "60", "--method", "tv", "--force")
    assert hurried["method"].startswith("Wiener")
    assert patient["method"] == "total variation"
    assert patient["iterations"] == [60]


def test_a_picture_of_several_pages_asks_which(labapp, grey, tmp_path):
    frame = np.load(tmp_path / "frame.npy")
    tifffile.imwrite(tmp_path / "two.tiff", np.stack([frame * 0, frame]), photometric="minisblack")
    psf = ("--psf", tmp_path / "psf.npy")
    code, _, errors = labapp("reconstruct", tmp_path / "two.tiff", *psf)
    assert (code, "--frame 0 to 1" in errors) == (1, True)
    told = said(labapp, tmp_path, "--frame", "1", name="two.tiff")
    assert told["residual"] < 1.2


BAD = {
    "no psf": (["frame.npy"], "what has blurred it? Give its PSF: --psf FILE"),
    "no file": (["none.png", "--psf", "psf.npy"], "none.png: cannot be read: there is no such"),
    "no picture": (["text.png", "--psf", "psf.npy"], "text.png: is not a picture"),
    "no tiff": (["text.tiff", "--psf", "psf.npy"], "text.tiff: is not a picture"),
    "no record": (["text.h5"], "text.h5: is not an HDF5 file"),
    "a word": (["words.npy", "--psf", "psf.npy"], "words.npy: holds <U3 values. Give real"),
    "a line": (["line.npy", "--psf", "psf.npy"], "line.npy: is 5; give rows x columns"),
    "nothing there": (["nan.npy", "--psf", "psf.npy"], "nan.npy: has no finite value"),
    "dark psf": (["frame.npy", "--psf", "zero.npy"], "zero.npy: sums to 0. A PSF must"),
    "nan psf": (["frame.npy", "--psf", "nan2.npy"], "nan2.npy: has NaN or infinite values"),
    "method": (["frame.npy", "--psf", "psf.npy", "--method", "magic"], "--method magic: is unkno"),
    "border": (["frame.npy", "--psf", "psf.npy", "--border", "x"], "--border x: take one of unkn"),
    "budget": (["frame.npy", "--psf", "psf.npy", "--budget", "0"], "--budget 0: give seconds"),
    "noise": (["frame.npy", "--psf", "psf.npy", "--noise", "-1"], "--noise -1: give a number"),
    "weight": (["frame.npy", "--psf", "psf.npy", "--weight", "1"], "Name one as well: --method tv"),
    "no time": (
        ["frame.npy", "--psf", "psf.npy", "--budget", "1e-9", "--method", "hyper-laplacian"],
        "budget is 1e-09 s; the quickest, hyper-laplacian, takes about",
    ),
    "ending": (
        ["frame.npy", "--psf", "psf.npy", "--out", "a.gif"],
        "choose .tiff, .npy, .exr, .hdr or .png",
    ),
    "picture": (["frame.npy", "--psf", "psf.npy", "--picture", "a.gif"], "must end in .png"),
    "over itself": (
        ["frame.npy", "--psf", "psf.npy", "--out", "frame.npy", "--force"],
        "frame.npy: is a file that is read. Choose another name",
    ),
    "truth": (["frame.npy", "--psf", "psf.npy", "--truth", "psf.npy"], "psf.npy: is 1 x 9 x 9"),
    "target": (["frame.npy", "--psf", "psf.npy", "--target", "a"], "is no record. Leave it out"),
    "all clipped": (["frame.npy", "--psf", "psf.npy", "--clip", "-9"], "--clip -9: every pixel"),
    "frame": (["frame.tiff", "--psf", "psf.npy", "--frame", "3"], "--frame 3: "),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_said_with_a_remedy_and_nothing_is_written(
    labapp, grey, tmp_path, monkeypatch, case
):
    monkeypatch.chdir(tmp_path)
    for ending in (".png", ".tiff", ".h5"):
        (tmp_path / f"text{ending}").write_text("no picture")
    np.save("words.npy", np.array(["one"]))
    np.save("line.npy", np.zeros(5))
    np.save("nan.npy", np.full((9, 9), np.nan))
    np.save("nan2.npy", np.where(np.eye(9), np.nan, 1))
    np.save("zero.npy", np.zeros((9, 9)))
    tifffile.imwrite("frame.tiff", np.load("frame.npy"))
    there = sorted(tmp_path.iterdir())
    arguments, words = BAD[case]
    code, _, errors = labapp("reconstruct", *arguments)
    assert code == 1
    assert words in errors
    assert "Traceback" not in errors
    assert sorted(tmp_path.iterdir()) == there


def test_nothing_is_replaced_without_leave(labapp, grey, tmp_path):
    said(labapp, tmp_path)
    code, _, errors = labapp("reconstruct", tmp_path / "frame.npy", "--psf", tmp_path / "psf.npy")
    assert (code, "exists already" in errors) == (1, True)


def test_a_psf_with_its_origin_in_the_corner_is_put_right_and_told(labapp, grey, tmp_path):
    centred = said(labapp, tmp_path, "--truth", tmp_path / "truth.npy")
    assert centred["notes"] == []
    for side in (21, 24):
        stored = np.pad(disk(4), [(side // 2 - 4, side - side // 2 - 5)] * 2)
        np.save(tmp_path / "psf.npy", np.fft.ifftshift(stored))
        told = said(labapp, tmp_path, "--truth", tmp_path / "truth.npy", "--force")
        assert told["score"]["psnr_db"][1] == pytest.approx(centred["score"]["psnr_db"][1], abs=0.1)
        (note,) = told["notes"]
        assert "wraps round the edges" in note


def test_a_psf_that_is_off_its_middle_pixel_is_told_and_moves_the_picture(labapp, grey, tmp_path):
    """An even array with an empty last row and column, and five pixels beside the middle."""
    said(labapp, tmp_path)
    usual = tifffile.imread(tmp_path / "frame_restored.tiff")
    for psf, off, words in (
        (np.pad(disk(4), (0, 1)), -1, "1.0 px up and 1.0 px left"),
        (np.pad(disk(4), (10, 0)), 5, "5.0 px down and 5.0 px right"),
    ):
        np.save(tmp_path / "psf.npy", psf)
        (note,) = said(labapp, tmp_path, "--force")["notes"]
        assert words in note
        found = tifffile.imread(tmp_path / "frame_restored.tiff")
        both = slice(max(0, off), len(grey) + min(0, off))
        own = slice(both.start - off, both.stop - off)
        lost = psnr(usual[both, both], grey[both, both]) - psnr(found[own, own], grey[both, both])
        assert lost <= 0.1


@pytest.mark.parametrize("unit", [2.0**-60, 1e-18, 1e18])
@pytest.mark.usefixtures("drawn")
def test_the_unit_of_the_light_doesnt_matter(labapp, grey, tmp_path, unit):
    """Noise, dark, full well and truth are told in the same unit."""
    frame, told = np.load(tmp_path / "frame.npy"), []
    for scale in (1.0, unit):
        np.save(tmp_path / "frame.npy", ((frame + 0.1) * scale).astype(np.float32))
        np.save(tmp_path / "truth.npy", (grey * scale).astype(np.float32))
        options = {"noise": 0.005 * scale, "dark": 0.1 * scale, "clip": 1.05 * scale}
        named = [one for name, value in options.items() for one in (f"--{name}", repr(value))]
        told.append(said(labapp, tmp_path, *named, "--truth", tmp_path / "truth.npy", "--force"))
    assert told[1]["score"]["psnr_db"] == pytest.approx(told[0]["score"]["psnr_db"], abs=0.02)
    assert told[1]["noise"][0] == pytest.approx(0.005 * unit)
    for same in ("verdict", "method", "iterations", "clipped_share"):
        assert told[1][same] == told[0][same]


@pytest.mark.parametrize("unit", [1e-300, 1e-42, 1e40])
def test_light_that_single_precision_doesnt_hold_is_refused(labapp, grey, tmp_path, unit):
    np.save(tmp_path / "frame.npy", np.load(tmp_path / "frame.npy").astype(float) * unit)
    code, _, errors = labapp("reconstruct", tmp_path / "frame.npy", "--psf", tmp_path / "psf.npy")
    assert code != 0
    assert "its largest value is" in errors
    assert "another unit" in errors


def test_a_dark_level_that_is_too_high_is_named_with_its_option(labapp, grey, tmp_path):
    told = said(labapp, tmp_path, "--dark", "0.3")
    assert told["causes"] == ["dark"]
    assert told["residual"] > 1.25
    options = ["--psf", tmp_path / "psf.npy", "--dark", "0.3", "--force"]
    _, printed, _ = labapp("reconstruct", tmp_path / "frame.npy", *options)
    assert "(--dark LEVEL)" in " ".join(printed.split())


def test_a_background_in_the_psf_is_mentioned(labapp, grey, tmp_path):
    np.save(tmp_path / "psf.npy", disk(4) + 0.1 * disk(4).max())
    (note,) = said(labapp, tmp_path)["notes"]
    assert "its edge is at" in note


PLAN = {
    "version": 1,
    "title": "Without roles",
    "patterns": {"neutral": {"kind": "constant"}, "lens": {"kind": "lens", "focal_length_m": 30}},
    "acquire": [
        {
            "targets": ["dark", "star", "photograph"],
            "patterns": ["neutral", "lens"],
            "wavelengths_nm": [550],
            "exposures_ms": [8, 64],
        }
    ],
}


def taken(small, path, **changes):
    with open_bench(small.bench_files) as bench:
        return run_plan(bench, PlanFile.model_validate(PLAN | changes), path).path


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    return taken(write_small(folder), folder / "run.h5")


@pytest.fixture
def run(whole, tmp_path) -> Path:
    """A record of its own."""
    return Path(shutil.copy(whole, tmp_path / "run.h5"))


@pytest.mark.usefixtures("drawn")
def test_a_record_brings_its_own_photograph_and_star(labapp, run, tmp_path):
    code, printed, errors = labapp("reconstruct", run, "--json")
    assert code == 0, errors
    told = json.loads(printed)
    assert "photograph, lens, 550 nm" in told["source"]
    assert told["psf"] == "star 'star' of the same run"
    assert told["unit"] == "electrons per second"
    merged = tifffile.imread(tmp_path / "run_restored.tiff")
    assert merged.shape == (64, 96)
    one = ("--target", "photograph", "--pattern", "neutral", "--psf", run, "--frame", "9")
    code, printed, errors = labapp(
        "reconstruct", run, *one, "--out", tmp_path / "one.png", "--json"
    )
    assert code == 0, errors
    assert "frame 9" in json.loads(printed)["source"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--target", "nobody"], "has no frames of 'nobody'; its targets are dark, star, photogra"),
        (["--pattern", "ring"], "has no frames of 'photograph' with pattern 'ring'"),
        (["--wavelength-nm", "600"], "at 550 nm, and not at 600. Choose one: --wavelength-nm"),
        (["--frame", "99"], "--frame 99: "),
        (["--star", "moon"], "has no star 'moon' with pattern 'lens'"),
        (["--clip", "4000"], "--clip: "),
    ],
)
def test_what_a_record_lacks_is_named(labapp, run, options, words):
    code, _, errors = labapp("reconstruct", run, *options)
    assert code == 1
    assert words in errors


def test_an_unknown_blur_is_looked_for_written_and_judged(labapp, tmp_path):
    """A stroke over disks: the picture gets nearer to the truth than it was."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:120, :130]
    sharp = np.full((120, 130), 0.3)
    for _ in range(30):
        at = np.hypot(y - rng.uniform(0, 120), x - rng.uniform(0, 130)) < rng.uniform(4, 20)
        sharp[at] = rng.uniform(0, 1)
    stroke = np.zeros((9, 9))
    stroke[range(1, 8), range(1, 8)] = 1 / 7
    truth, frame = valid(sharp, stroke)
    np.save(tmp_path / "frame.npy", noisy(frame, 0.003).astype(np.float32))
    code, printed, errors = labapp(
        "reconstruct", tmp_path / "frame.npy", "--blind", 9, "--out", tmp_path / "out.npy", "--json"
    )
    assert code == 0, errors
    told = json.loads(printed)
    assert "looked for" in told["psf"]
    assert "score" in told["notes"][0]
    found = np.load(told["psf_file"])
    assert found.shape == (9, 9)
    assert found.sum() == pytest.approx(1, abs=1e-5)
    inside = slice(8, -8), slice(8, -8)
    answer = np.load(tmp_path / "out.npy")
    left = min(
        np.abs((np.roll(answer, shift, (0, 1)) - truth)[inside]).mean()
        for shift in ((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1))
    )
    assert left < 0.8 * np.abs((frame - truth)[inside]).mean()


def test_a_known_blur_is_not_looked_for(labapp, grey, tmp_path):
    code, _, errors = labapp(
        "reconstruct", tmp_path / "frame.npy", "--psf", tmp_path / "psf.npy", "--blind", 9
    )
    assert code == 1
    assert "--blind and --psf are both given" in errors
    assert not list(tmp_path.glob("*restored*"))
