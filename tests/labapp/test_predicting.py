"""`labapp psf`: a PSF with its price, by itself."""

from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pytest

from labapp.figures.psf import psf_cost
from labapp.figures.quadrature import round_lens_picture
from optics.camera import Lens

LENS = ["--focal-length", "0.1", "--f-number", "5.6", "--focus", "inf", "--wavelength-nm", "520"]


def test_a_psf_is_written_with_a_picture_and_keeps_its_tolerance(labapp, tmp_path):
    out = tmp_path / "psf.npy"
    code, printed, _ = labapp(
        "psf", *LENS, "--size", "64", "--tol", "1e-7", "--points", "--out", out, "--json"
    )
    assert code == 0
    said = json.loads(printed)
    assert said["error_predicted"] <= said["tol"] == 1e-7
    truth = round_lens_picture(Lens(0.1, 5.6, math.inf), 2.0, 520e-9, 3.45e-6, 64)
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
    arguments = ["--pattern", tmp_path / "ramp.png", "--bench", small.bench, "--size", "128"]
    code, printed, _ = labapp("psf", *arguments, "--out", out, "--json")
    assert code == 0, printed
    row, column = np.unravel_index(np.load(out).argmax(), (128, 128))
    shift = 550e-9 * (1 / (1 / 0.125 - 1 / 2.0)) / (8 * 80e-6) / 3.45e-6
    assert (row, column) == (64, 64 + round(shift))


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
