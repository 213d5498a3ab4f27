"""What nobody means is refused in words, or answered, and never takes long."""

import math

import pytest
import torch
from judges.absurd_questions import ANSWERED, REFUSED, ask

from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Stop, regular_polygon
from optics.plane import Plane
from optics.propagation import FreeSpace
from optics.psf import PSFOperator
from optics.quantity_ranges import ask_about_unit

PIXELS = Plane((8, 8), (2e-6, 2e-6))
GREEN = 550e-9


LENS = Lens(0.05, 8.0, 2.0)


def light(lens=LENS, distance=2.2, wavelength=GREEN, pixels=PIXELS, **settings):
    return PSFOperator(lens, distance, wavelength, pixels, **settings)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: light(wavelength=520), r"wavelength is 520 m, .*did you mean 520 nm, 5\.2e-07\?"),
        (lambda: light(wavelength=0.52), r"wavelength is 0\.52 m, .*mean 0\.52 µm, 5\.2e-07\?"),
        (lambda: light(wavelength=5.2e-10), r"wavelength is 5\.2e-10 m, .*did you mean 5\.2e-07\?"),
        (lambda: Lens(50.0, 8.0, 2.0), r"focus_distance is 2 m; .*, 50 m .*mean 50 mm, 0\.05\?"),
        (lambda: Lens(0.05, 1e-3), r"f_number is 0\.001, less than 0\.01; give the focal length"),
        (lambda: Lens(1e9), r"focal_length is 1e\+09 m, more than 1e\+06 m; give metres"),
        (lambda: Panel(pitch=8.0), r"pitch is 8 m, more than 1 m; .*did you mean 8 µm, 8e-06\?"),
        (lambda: Camera(separation=1e7), r"separation is 1e\+07 m, more than 1e\+06 m"),
        (lambda: Lens(aberrations=((4, 0, 55.0),)), r"\(4, 0\) is 55 m, .*mean 55 nm, 5\.5e-08\?"),
        (lambda: light(field=(1e9, 0.0)), r"field is 1e\+09 m, more than 1000 m"),
        (lambda: light(pixels=Plane((8, 8), (1e3, 1e3))), r"the pixels' pitch is 1000 m"),
        (lambda: light(phase_slope=math.nan), r"phase_slope is nan; give the radians"),
        (lambda: light(pixel_tol=-1.0), r"pixel_tol is -1; it must be positive"),
        (lambda: FreeSpace(PIXELS, PIXELS, 1e-300, GREEN), r"distance is 1e-300 m, less than"),
        (lambda: Panel((10**5, 10**4)), r"shape \(100000, 10000\) has 1e\+09 pixels"),
        (lambda: regular_polygon(10**9), r"sides is 1000000000; .* 5000 at most"),
    ],
)
def test_a_number_that_nobody_means_is_asked_about(call, told):
    with pytest.raises(ValueError, match=told):
        call()


def test_truths_and_halves_are_no_numbers():
    with pytest.raises(TypeError, match="distance is True, a bool; give one number in m"):
        light(distance=True)
    for shape in ((2.5, 8), (True, 8), (8,)):
        with pytest.raises(TypeError, match="must be two whole numbers"):
            Plane(shape, (1e-6, 1e-6))


@pytest.mark.parametrize(
    ("quantity", "value", "asked"),
    [
        ("wavelength", 633.0, ": did you mean 633 nm, 6.33e-07?"),
        ("focal_length", 1e9, ""),
        ("panel_pitch", 8.0, ": did you mean 8 µm, 8e-06?"),
        ("f_number", 1e-3, ""),
    ],
)
def test_a_unit_is_asked_about_where_it_is_usual(quantity, value, asked):
    assert ask_about_unit(quantity, value) == asked


HEXAGON = Lens(0.1, 5.6, 2.0, Stop(regular_polygon(6)))


@pytest.mark.parametrize(
    "call",
    [
        # Planned, these took 559 s, 24 GB, or no end.
        lambda: light(HEXAGON, 1e-4),
        lambda: light(pixels=Plane((1, 100_000), (1e-6, 1e-6))),
        lambda: light(pixels=Plane((8, 8), (1e-6, 1e-6), (1e3, 0.0))),
        lambda: light(pixels=Plane((8, 8), (0.1, 0.1))),
        lambda: light(pixels=Plane((10**6, 10**6), (1e-6, 1e-6)), integrate=False),
    ],
)
def test_what_costs_too_much_is_refused_before_it_is_begun(call):
    with pytest.raises(ToleranceError, match=r"(take about \S+ [sh] of|needs \S+ [MP]B at least)"):
        call()


def test_the_time_that_is_allowed_is_the_budget_s():
    with pytest.raises(ToleranceError, match=r"1e-06 s .* allowed.*; allow more time"):
        light(budget=Budget(seconds=1e-6))
    assert light(budget=Budget(seconds=math.inf)).account.tol == 1e-3


@pytest.mark.parametrize(
    "call",
    [
        # A microscope, a telescope, terahertz, extreme ultraviolet, a large telescope's mirror.
        lambda: light(Lens(1e-3, 1.0, 1.1e-3), 1.1e-3),
        lambda: light(Lens(10.0, 10.0, math.inf), 1e9),
        lambda: light(wavelength=1e-3, pixels=Plane((8, 8), (1e-3, 1e-3))),
        lambda: light(Lens(0.05, 100.0, 2.0), wavelength=13.5e-9),
        lambda: light(Lens(1e3, 25.0, math.inf), math.inf, pixels=Plane((8, 8), (1e-5, 1e-5))),
    ],
)
def test_sound_but_unusual_optics_are_answered(call):
    operator = call()
    assert operator.account.error <= 1e-3
    answer = operator()
    assert bool(torch.isfinite(answer).all())
    assert float(answer.sum()) > 0


@pytest.mark.parametrize("seed", range(12))
def test_a_drawn_absurd_question_is_answered_or_refused_in_words(seed):
    """Hundreds of others, and their times: `make figures ONLY="absurd questions"`."""
    found = ask(seed)
    assert found.fate in (ANSWERED, REFUSED), found
    assert found.bytes <= Budget().memory, found
