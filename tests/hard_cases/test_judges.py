"""Judges are judged as well: those that know the same thing differently must agree."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from judges import quadrature_psf, relative

from hard_cases.judges import (
    Judge,
    by_airy,
    by_edges,
    by_fresnel,
    by_lines,
    by_lommel,
    by_panel,
    by_rings,
    covered,
    open_area,
    richardson,
)
from hard_cases.lenses import HEXAGON, LENS, SQUARE, behind, defocused
from hard_cases.panels import CAMERA, camera, stop_of
from hard_cases.view import WAVELENGTH, View
from optics.plane import Plane
from optics.stop.aperture import Circle, Stop, rectangle

PIXELS = Plane((4, 5), (3e-6, 4e-6), (1e-6, 2e-6))


@pytest.mark.parametrize("integrate", [True, False])
@pytest.mark.parametrize(
    ("view", "judges"),
    [
        (View(LENS, PIXELS), (by_airy, by_rings, by_lines)),
        (View(behind(Circle(), Circle(0.4)), PIXELS), (by_airy, by_rings, by_lines)),
        (View(LENS, PIXELS, defocused(LENS, 7)), (by_lommel, by_rings, by_lines)),
        (View(HEXAGON, PIXELS), (by_edges, by_lines)),
        (View(SQUARE, PIXELS, defocused(LENS, 7)), (by_fresnel, by_lines)),
    ],
    ids=["a disc", "a ring", "a blur", "a hexagon", "a square"],
)
def test_judges_agree(view: View, judges: tuple[Judge, ...], integrate: bool) -> None:
    first, *others = (judge(replace(view, integrate=integrate)) for judge in judges)
    for other in others:
        assert relative(other, first) <= 1e-11


def test_a_panel_without_gaps_is_the_rectangle_that_it_is() -> None:
    """The same opening as a stop, for Fresnel's integrals; and the judge of other tests."""
    optics = camera(stop_of(25e-3), fill_factor=1.0)
    rows, columns = (n * 40e-6 / 12.5e-3 for n in optics.panel.shape)
    # The origin of an even number of pixels lies half a pixel beside the middle.
    middle = (-0.5 * 40e-6 / 12.5e-3, 0.0)
    lens = replace(optics.lens, stop=Stop(rectangle(rows, columns, middle)))
    view = View(optics, PIXELS, 1.2, phase=np.zeros(optics.panel.shape))
    assert relative(by_panel(view), by_fresnel(replace(view, optics=lens, phase=None))) <= 1e-11
    square = replace(view, pixels=CAMERA.sensor.window((4, 5)))
    flat = np.zeros(optics.panel.shape)
    truth = quadrature_psf(optics, flat, 1.2, WAVELENGTH, (4, 5), across_panel_pixel=12)
    assert relative(by_panel(square), truth) <= 1e-9


def test_areas_are_those_of_circles_and_their_parts() -> None:
    assert open_area(Stop()) == pytest.approx(math.pi, rel=1e-13)
    assert open_area(Stop(Circle(), (Circle(0.5, (0.2, 0.3)),))) == pytest.approx(
        0.75 * math.pi, rel=1e-13
    )
    quarters = covered(Stop(), 1.0, Plane((2, 2), (1.0, 1.0), (0.5, 0.5)))
    assert quarters == pytest.approx(math.pi / 4, rel=1e-13)


def test_differences_find_derivatives() -> None:
    assert richardson(math.exp, 0.3, 0.1) == pytest.approx(math.exp(0.3), rel=1e-12)
