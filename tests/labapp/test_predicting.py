"""`labapp psf`: a PSF with its price, by itself."""

from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pytest
from figures.psf import psf_cost
from judges import View, by_rings

from optics.camera import Lens
from optics.plane import Plane


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


LENS = ["--focal-length", "0.1", "--f-number", "5.6", "--focus", "inf", "--wavelength-nm", "520"]


def test_a_psf_is_written_with_a_picture_and_keeps_its_tolerance(labapp, tmp_path):
    out = tmp_path / "psf.npy"
    code, printed, _ = labapp(
        "psf", *LENS, "--size", "64", "--tol", "1e-7", "--points", "--out", out, "--json"
    )
    assert code == 0
    said = json.loads(printed)
    assert said["error_predicted"] <= said["tol"] == 1e-7
    pixels = Plane((64, 64), (3.45e-6, 3.45e-6))
    truth = by_rings(View(Lens(0.1, 5.6, math.inf), pixels, 2.0, 520e-9, integrate=False))
    value = np.load(out)
    assert np.linalg.norm(value - truth) <= 1e-7 * np.linalg.norm(truth)
    picture = cv2.imread(str(tmp_path / "psf.png"), 0)
    assert picture.shape == (64, 64)
    assert picture.max() == 255


def test_the_account_is_printed_for_people(labapp, tmp_path):
    code, printed, _ = labapp(
        "psf", "--size", "32", "--method", "axial", "--out", tmp_path / "psf.tiff"
    )
    assert code == 0
    for words in ("Hankel transform", "error of the model", "light in the window"):
        assert words in printed
    values = cv2.imread(str(tmp_path / "psf.tiff"), cv2.IMREAD_UNCHANGED)
    assert values.dtype == np.float32
    assert 0.5 < values.sum() < 1


def test_a_pattern_on_the_panel_shapes_the_psf(labapp, small, tmp_path):
    """A ramp of one wave in eight pixels moves the spot by wavelength z / (8 pitch)."""
    levels = 255 / (6.390462 / 2)
    ramp = np.round(np.arange(192) % 8 / 8 * levels).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "ramp.png"), np.tile(ramp, (108, 1)))
    out = tmp_path / "psf.npy"
    arguments = ["--pattern", tmp_path / "ramp.png", "--camera", small.bench, "--size", "128"]
    code, printed, _ = labapp("psf", *arguments, "--out", out, "--json")
    assert code == 0, printed
    row, column = np.unravel_index(np.load(out).argmax(), (128, 128))
    shift = 550e-9 * (1 / (1 / 0.125 - 1 / 2.0)) / (8 * 80e-6) / 3.45e-6
    assert (row, column) == (64, 64 + round(shift))


def test_a_cameras_file_says_what_the_options_do_not(labapp, small, tmp_path):
    """A neutral panel, larger than its lens and of whole pixels, isn't there: the lens alone."""
    change(small.bench, "fill_factor = 0.9", "fill_factor = 1.0")
    change(small.bench, "f_number = 5.0", "f_number = 16.0")
    change(small.bench, "focus_distance_m = 2.0", "focus_distance_m = inf\nblades = 6")
    change(small.bench, "pitch_um = 3.45", "pitch_um = 3.0")
    want, got = tmp_path / "want.npy", tmp_path / "got.npy"
    lens = ["--focal-length", "0.125", "--focus", "inf", "--blades", "6", "--pitch-um", "3"]
    common = ["--distance", "5", "--size", "32", "--points"]
    for number in ("16", "20"):
        code, said, _ = labapp(
            "psf", *common, *lens, "--f-number", number, "--out", want, "--force"
        )
        assert code == 0, said
        override = ["--f-number", number] if number == "20" else []
        arguments = ["--camera", small.bench, *override, "--out", got, "--force"]
        code, said, _ = labapp("psf", *common, *arguments)
        assert code == 0, said
        # The grid's jagged pixels at the stop's edge are what is left of the difference.
        difference = np.load(got) - np.load(want)
        assert np.linalg.norm(difference) <= 0.03 * np.linalg.norm(np.load(want))


CHAIN = """focus_distance_m = 2.0
separation_mm = 50.0
[polarisation]
polariser = { angle_deg = 30.0 }
"""


@pytest.fixture
def apart(small):
    """The small bench's camera, with its panel before the lens and a turned polariser."""
    change(small.bench, "focus_distance_m = 2.0\n", CHAIN)
    change(small.bench, "unmodulated = 0.05\n", "")
    return small.bench


def test_a_camera_tells_what_becomes_of_the_light(labapp, apart, tmp_path):
    """sin² 30° isn't modulated, and off the axis the panel's edge is in the way."""
    asked = ["--camera", apart, "--distance", "1.5", "--size", "32", "--f-number", "16"]
    out = tmp_path / "psf.npy"
    code, printed, said = labapp("psf", *asked, "--out", out)
    assert code == 0, said
    for words in ("light through the stop", "25.00 %", "none: the two are polarised across"):
        assert words in printed
    off = [*asked, "--field", "0,12", "--out", out, "--force", "--json"]
    code, printed, said = labapp("psf", *off)
    assert code == 0, said
    told = json.loads(printed)
    # On the panel the shadow of the stop of 3.9 mm is smaller, and lies beside the axis where
    # the ray through the lens' middle does. The panel's edge, 7.68 mm and half a pixel away,
    # cuts off a segment.
    stop, z2 = 125 / 16 / 2, 1 / (1 / 125 - 1 / 2000)
    radius, away = stop / (1 + 50 / 1500), 7.72 - 50 * 12 / z2
    segment = radius**2 * math.acos(away / radius) - away * math.sqrt(radius**2 - away**2)
    share = (math.pi * radius**2 - segment) / (math.pi * stop**2)
    assert told["through_stop"] == pytest.approx(share, rel=1e-3)
    assert told["interference"] == pytest.approx(0, abs=1e-12)
    assert told["unmodulated"] == pytest.approx(0.25)
    assert told["sum"] <= told["through_stop"] + 1e-3 <= 1.001


def test_an_analyser_lets_modulated_and_unmodulated_light_interfere(labapp, apart, tmp_path):
    change(apart, "angle_deg = 30.0 }", "angle_deg = 30.0 }\nanalyser = { angle_deg = 60.0 }")
    asked = ["--camera", apart, "--size", "16", "--out", tmp_path / "psf.npy"]
    code, printed, said = labapp("psf", *asked)
    assert code == 0, said
    # cos 30° cos 60° and sin 30° sin 60° are the same.
    assert "50.00 %" in printed
    assert "1 √(modulated × unmodulated PSF)" in printed


def test_a_sphere_differs_from_its_parabola_near_the_camera(labapp, small, tmp_path):
    """By a path of r⁴/8d³ = 0.09 waves at 0.25 m, in the panel's corners; not at 10 m."""
    differences = []
    for distance in ("0.25", "10"):
        found = []
        for number, sphere in enumerate(([], ["--sphere"])):
            out = tmp_path / f"{number}.npy"
            asked = ["--camera", small.bench, "--distance", distance, "--size", "200"]
            code, _, said = labapp("psf", *asked, *sphere, "--out", out, "--force")
            assert code == 0, said
            found.append(np.load(out))
        differences.append(np.linalg.norm(found[1] - found[0]) / np.linalg.norm(found[0]))
    near, far = differences
    assert 3e-3 < near < 0.2
    assert far < 2e-3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--tol", "1e-15"], "ask for tol"),
        (["--tol", "0"], "ask for tol"),
        (["--distance", "0"], "distance is 0 m"),
        (["--f-number", "-2"], "f_number is -2"),
        (["--focus", "0.01"], "focus_distance is 0.01 m"),
        (["--size", "0"], "at least 1 pixel"),
        (["--pattern", "none.png"], "none.png: cannot be read"),
        (["--camera", "none.toml"], "none.toml: cannot be read"),
        (["--field", "1"], "--field 1: give 2 numbers with ','"),
        (["--field", "nan,0"], "--field nan,0: 'nan' isn't a number"),
        (["--field", "0,1"], "--field: a lens alone"),
        (["--sphere"], "--sphere: a lens alone"),
    ],
)
def test_a_question_without_an_answer_is_refused_in_words(labapp, tmp_path, arguments, words):
    code, _, said = labapp("psf", *arguments, "--out", tmp_path / "psf.npy")
    assert code == 1
    assert words in said
    assert list(tmp_path.iterdir()) == []


def test_existing_files_and_unknown_endings_are_refused(labapp, tmp_path):
    (tmp_path / "psf.png").write_text("precious")
    code, _, said = labapp("psf", "--size", "8", "--out", tmp_path / "psf.npy")
    assert (code, "--force" in said) == (1, True)
    assert (tmp_path / "psf.png").read_text() == "precious"
    code, _, said = labapp("psf", "--out", tmp_path / "psf.exe")
    assert (code, ".npy, .tiff, .png" in said) == (1, True)


def test_the_figure_measures_errors_below_their_tolerances(tmp_path):
    (figure,) = psf_cost(tmp_path)
    errors = [float(text) for text in figure.measured.split("errors ")[1].split(" / ")]
    assert [error <= tol for error, tol in zip(errors, (1e-3, 1e-6, 1e-9), strict=True)] == [
        True
    ] * 3
