"""`labapp simulate`: frames of a scene as files, read back as other programs read them."""

import json

import cv2
import h5py
import numpy as np
import pytest
import tifffile
from small_bench.files import TINY

GAIN, BLACK = 2.6, 64.0


@pytest.fixture
def take(tiny, labapp):
    def taken(name, *options):
        out = tiny.folder / name
        exposed = () if "--exposure-ms" in options else ("--exposure-ms", "20")
        bare = () if "--everything" in options else ("--set", "panel orders=off")
        arguments = ("--bench", tiny.bench, "--out", out, *exposed, *bare, *options)
        code, printed, complaint = labapp("simulate", tiny.scene, *arguments)
        return out, code, printed, complaint

    return taken


def test_hdf5_holds_frames_their_mean_and_variance_and_what_was_decided(take):
    out, code, printed, _ = take("a.h5", "--target", "photograph", "--frames", "60")
    assert code == 0
    assert "60 frames of 45 x 40 pixels" in printed
    with h5py.File(out) as file:
        frames, mean, variance, electrons = (
            file[name][...] for name in ("frames", "mean", "variance", "electrons")
        )
        plan = json.loads(file["effect_plan"].asstr()[()])
        bench, scene = (json.loads(file[name].asstr()[()]) for name in ("bench", "scene"))
    assert frames.dtype == np.uint16
    assert frames.shape == (60, *TINY.sensor)
    assert electrons.shape == TINY.sensor
    assert plan["target"] == "photograph"
    assert plan["decisions"]
    assert bench["name"] == "Small bench"
    assert scene["title"] == "Small scene"
    # What is drawn has the mean and the variance that are told; 60 draws know them so well.
    numbers = (frames - BLACK) * GAIN
    spread = np.sqrt(variance / 60)
    assert np.abs((numbers.mean(0) - mean) / spread).mean() == pytest.approx(0.8, abs=0.05)
    assert (numbers.var(0, ddof=1) / variance).mean() == pytest.approx(1, abs=0.03)
    # Electrons and darkness are the mean, where no well is full.
    assert np.abs(mean - electrons - 0.02).max() <= 1


def test_the_same_seed_is_the_same_noise_and_another_one_is_not(take):
    first, second, third = (
        tifffile.imread(take(name, "--target", "photograph", "--seed", seed)[0])
        for name, seed in (("a.tiff", "1"), ("b.tiff", "1"), ("c.tiff", "2"))
    )
    assert (first == second).all()
    assert (first != third).any()


def test_tiff_holds_all_frames_and_says_what_was_decided(take):
    out, code, _, _ = take("a.tif", "--target", "photograph", "--frames", "3")
    assert code == 0
    with tifffile.TiffFile(out) as file:
        assert len(file.pages) == 3
        plan = json.loads(file.pages[0].description)["effect_plan"]
    assert plan["exposure_ms"] == 20
    frames = tifffile.imread(out)
    assert frames.dtype == np.uint16
    assert frames.shape == (3, *TINY.sensor)
    assert (frames[0] != frames[1]).any()


def test_png_is_the_same_frame(take):
    png, code, _, _ = take("a.png", "--target", "photograph")
    assert code == 0
    read = cv2.imread(str(png), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16
    assert (read == tifffile.imread(take("a.tiff", "--target", "photograph")[0])).all()


def test_everything_is_what_no_tolerance_leaves_out(take):
    out, code, _, _ = take("a.h5", "--target", "star", "--everything")
    assert code == 0
    with h5py.File(out) as file:
        plan = json.loads(file["effect_plan"].asstr()[()])
    assert plan["error"] == 0
    assert plan["work"] == plan["most_work"]
    assert all(one["level"] == one["levels"][-1] for one in plan["decisions"])


def test_an_effect_that_is_forced_off_is_off(take):
    options = ("--target", "star", "--set", "shot noise=off", "--set", "read noise=off")
    out, code, _, _ = take("a.h5", *options)
    assert code == 0
    with h5py.File(out) as file:
        # A step of the converter is all the noise that is left.
        assert file["variance"][...].max() <= GAIN**2 / 4
        frames = file["frames"][...]
    assert np.abs(np.diff(frames, axis=0)).sum() == 0


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("a.jpg", [], ["a.jpg", ".h5, .tiff or .png"]),
        ("a", [], [".h5, .tiff or .png"]),
        ("a.png", ["--frames", "2"], ["one frame", ".h5 or .tiff"]),
        ("a.h5", ["--frames", "0"], ["--frames 0"]),
        ("a.h5", ["--target", "moon"], ["moon"]),
        ("a.h5", ["--seed", "-1"], ["--seed -1"]),
        ("none/a.h5", [], ["none"]),
    ],
)
def test_what_cannot_be_written_is_said_before_anything_is_computed(take, name, options, words):
    out, code, _, complaint = take(name, *options)
    assert code == 1
    assert not out.exists()
    assert "Traceback" not in complaint
    for word in words:
        assert word in complaint


def test_a_file_is_replaced_only_if_asked(take):
    out, code, _, _ = take("a.png", "--target", "dark")
    assert code == 0
    before = out.read_bytes()
    _, code, _, complaint = take("a.png", "--target", "dark", "--seed", "5")
    assert code == 1
    assert "--force" in complaint
    assert out.read_bytes() == before
    _, code, _, _ = take("a.png", "--target", "dark", "--seed", "5", "--force")
    assert code == 0
    assert out.read_bytes() != before
