"""Judges are judged as well: those that know the same thing differently must agree."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from judges import (
    Beam,
    Edges,
    Judge,
    by_airy,
    by_chain,
    by_edges,
    by_fresnel,
    by_lines,
    by_lommel,
    by_panel,
    by_rings,
    covered,
    direct_field,
    open_area,
    quadrature_psf,
    relative,
    richardson,
)
from judges.fields import Cells, Points, Pulse, by_space, by_spectrum
from judges.view import WAVELENGTH, View

from hard_cases.chains import PIXELS as CHAIN_PIXELS
from hard_cases.chains import apart, at
from hard_cases.lenses import HEXAGON, LENS, SQUARE, behind, defocused
from hard_cases.panels import CAMERA, camera, random, stop_of
from optics.camera.stop import Circle, Stop, rectangle
from optics.plane import Plane

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
    square = replace(view, pixels=CAMERA.sensor.window_plane((4, 5)))
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


# Free space


def points(distance: float, reach: float) -> Points:
    """Seven places, none like another."""
    y, x = reach * np.cos(3 * np.arange(7.0)), reach * np.sin(2 + 5 * np.arange(7.0) ** 2)
    return Points(y, x, 0 * y, distance, WAVELENGTH)


@pytest.mark.parametrize("distance", [1e-5, -1e-5, 3e-4])
def test_a_round_beam_is_one_by_all_integrals(distance: float) -> None:
    """In waves along and around the axis, over the field, and as a sum over samples."""
    beam, pulse = Beam(3e-6), Pulse(0.0, 0.0, complex(3e-6**-2))
    where = points(distance, 4e-6 + 0.1 * abs(distance))
    truth = beam.field(where, paraxial=False)
    for judge in (by_spectrum, by_space):
        assert relative(judge(pulse, pulse, where), truth) <= 1e-11
    plane = Plane((127, 128), (0.25e-6, 0.25e-6))
    assert relative(direct_field(beam.samples(plane), plane, where), truth) <= 1e-10


def test_a_sum_over_samples_knows_fresnels_kernel() -> None:
    pulse = Pulse(0.0, 0.0, complex(3e-6**-2))
    where, plane = points(3e-4, 3e-5), Plane((127, 128), (0.25e-6, 0.25e-6))
    scale = WAVELENGTH * where.z
    truth = pulse.paraxial(where.y, scale) * pulse.paraxial(where.x, scale)
    found = direct_field(Beam(3e-6).samples(plane), plane, where, paraxial=True)
    assert relative(found, truth) <= 1e-10


@pytest.mark.parametrize("distance", [1e-4, -1e-4, 2e-3])
def test_cells_are_their_edges(distance: float) -> None:
    """Along edges, and over the cells' areas."""
    plane, sides = Plane((3, 4), (10e-6, 8e-6)), (9e-6, 8e-6)
    values = np.random.default_rng(1).normal(size=(2, 3, 4))
    light = values[0] + 1j * values[1]
    where = points(distance, 4e-5)
    by_area = Cells(plane, sides, light).field(where, paraxial=False)
    assert relative(Edges(plane, sides, light).field(where, paraxial=False), by_area) <= 1e-10


def test_half_of_a_wave_is_under_an_edge() -> None:
    """By symmetry; the other edges are a thousand distances away."""
    wide = Edges(Plane((1, 1), (1.0, 1.0)), (8e-4, 8e-4), np.ones((1, 1), dtype=complex))
    under = Points(np.zeros(3), np.array([0.0, 4e-4, 5e-4]), np.zeros(3), 2e-7, WAVELENGTH)
    found = wide.field(under, paraxial=False)
    assert np.abs(found - [1, 0.5, 0]).max() <= 1e-3


# The chain


def test_a_chain_that_collapses_is_a_panel_in_a_lens() -> None:
    """A wide stop passes nearly all light of coarse pixels; the ray matrix knows the rest."""
    optics = apart(0.4, stop=8e-3, shape=(3, 4), pitch=150e-6, fill_factor=1.0)
    view = at(optics, 1.5, pixels=CHAIN_PIXELS)
    lever, focus = optics.ray_matrix_b, optics.lens.focus_distance - 0.4
    focal_length = 1 / (1 / lever + 1 / focus)
    thin = replace(optics.lens, focal_length=focal_length, focus_distance=focus,
                   f_number=focal_length / 8e-3)  # fmt: skip
    together = replace(optics, separation=0.0, lens=thin)
    panel = by_panel(View(together, CHAIN_PIXELS, 1.5, phase=random(optics)))
    assert relative(by_chain(view), panel) <= 5e-3
