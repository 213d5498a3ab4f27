"""A lens in the words of the command line."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from judges import View, by_lines

from labapp.common.errors import UserError
from labapp.prediction.lens_options import (
    LensCase,
    read_aberrations,
    read_centre,
    read_stop,
    read_window,
)
from optics.camera import Lens
from optics.camera.stop import Circle, Stop, rectangle, regular_polygon
from optics.plane import Plane


def test_stops_are_read_as_they_are_said():
    assert read_stop(0, 0.0, None) == Stop()
    assert read_stop(6, 0.0, None) == Stop(regular_polygon(6))
    assert read_stop(0, 0.3, None) == Stop(Circle(), (Circle(0.3),))
    assert read_stop(0, 0.0, "0.5x0.7") == Stop(rectangle(1.0, 1.4))


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (lambda: read_stop(6, 0.0, "0.5x0.5"), "a stop is one or the other"),
        (lambda: read_stop(0, 1.0, None), "--obscuration 1: it must lie from 0 to below 1"),
        (lambda: read_stop(0, 0.0, "0.5"), "--rectangle 0.5: give 2 numbers with 'x'"),
        (lambda: read_aberrations(["4,0"]), "--zernike 4,0: give 3 numbers with ','"),
        (lambda: read_aberrations(["4.5,0,20"]), "N and M are whole numbers"),
        (lambda: read_centre("near"), "--centre near: give 2 numbers"),
        (lambda: read_window(0, 1e-6, "0,0"), "--size 0: a window has at least 1 pixel"),
    ],
)
def test_what_cannot_be_read_is_refused_by_its_option(read, words):
    with pytest.raises(UserError, match=words):
        read()


def test_a_case_is_named_by_what_is_special_about_it():
    lens = Lens(0.1, 5.6, math.inf)
    pixels = Plane((64, 64), (3.45e-6, 3.45e-6))
    assert LensCase(lens, 2.0, 520e-9, pixels).name == (
        "100 mm f/5.6, 520 nm, object at 2 m, focus at infinity, 64² of 3.45 µm"
    )
    odd = Lens(0.1, 5.6, 2.0, read_stop(6, 0.2, None), ((4, 0, 25e-9),), "stigmatic")
    name = LensCase(odd, math.inf, 520e-9, Plane((8, 9), (1e-6, 1e-6), (0.0, 2e-5))).name
    for words in ("at infinity", "9x8", "stigmatic", "6 blades", "obscured", "Z(4, 0) 25 nm"):
        assert words in name
    assert name.endswith("centre 0, 20 µm")


def test_every_option_of_a_lens_reaches_the_psf(labapp, tmp_path):
    """Against slices of the same stop."""
    out = tmp_path / "psf.npy"
    options = ["--focal-length", "0.05", "--f-number", "8", "--focus", "inf", "--distance", "4"]
    options += ["--wavelength-nm", "520", "--pitch-um", "3", "--size", "16", "--points"]
    options += ["--blades", "6", "--obscuration", "0.2", "--zernike", "4,0,60"]
    options += ["--zernike", "3,-1,40", "--centre", "0,20", "--lens", "stigmatic"]
    code, printed, _ = labapp("psf", *options, "--tol", "1e-6", "--out", out, "--json")
    assert code == 0
    assert json.loads(printed)["error_predicted"] <= 1e-6
    stop = Stop(regular_polygon(6), (Circle(0.2),))
    lens = Lens(0.05, 8.0, math.inf, stop, ((4, 0, 60e-9), (3, -1, 40e-9)), "stigmatic")
    pixels = Plane((16, 16), (3e-6, 3e-6), (0.0, 20e-6))
    truth = by_lines(View(lens, pixels, 4.0, 520e-9, integrate=False))
    assert np.linalg.norm(np.load(out) - truth) <= 1e-6 * np.linalg.norm(truth)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--lens", "perfect"], "kind is 'perfect'; choose thin or stigmatic"),
        (["--zernike", "3,0,20"], "Zernike (3, 0) doesn't exist"),
        (["--blades", "2"], "sides is 2; an opening has three or more"),
        (["--method", "magic"], "choose one of axial, scattered, sampled"),
        (["--memory-mb", "1"], "1 MB are allowed"),
    ],
)
def test_an_impossible_lens_is_refused_in_words(labapp, tmp_path, options, words):
    code, _, said = labapp("psf", *options, "--out", tmp_path / "psf.npy")
    assert code == 1
    assert words in said
    assert list(tmp_path.iterdir()) == []
