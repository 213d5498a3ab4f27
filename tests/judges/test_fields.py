"""The judges of free space against each other and against Fresnel's integral."""

from __future__ import annotations

import numpy as np
import pytest

from judges import relative
from judges.fields import Cells, Gaussians, Points, Pulse, by_space, by_spectrum, panels
from optics.plane import Plane


def some_points(depth: float = 0.0, distance: float = 2e-3) -> Points:
    rng = np.random.default_rng(1)
    y, x, z = rng.uniform(-8e-5, 8e-5, (3, 8))
    return Points(y, x, depth * z, distance, 600e-9)


PAIR = (Pulse(10e-6, 2e4, 1 / 40e-6**2 + 2e8j), Pulse(-5e-6, -1e4, 1 / 60e-6**2 - 1e8j))


@pytest.mark.parametrize(("depth", "distance"), [(0.0, 2e-3), (0.0, -3e-3), (2.0, 2e-3)])
def test_the_judges_two_integrals_agree(depth, distance):
    """Over plane waves, and over spherical ones."""
    points = some_points(depth, distance)
    assert relative(by_spectrum(*PAIR, points), by_space(*PAIR, points)) < 1e-12


@pytest.mark.parametrize("distance", [2e-3, -3e-3])
def test_the_judges_paraxial_gaussian_is_fresnels_integral(distance):
    points, scale = some_points(2.0, distance), None
    scale = points.wavelength * points.z[:, None]
    sums = []
    for pulse, where in zip(PAIR, (points.y, points.x), strict=True):
        half = 6 * pulse.width
        u, weight = panels(pulse.middle - half, pulse.middle + half, 400)
        kernel = np.exp(1j * np.pi * (where[:, None] - u) ** 2 / scale)
        sums.append(kernel @ (weight * pulse.at(u)))
    truth = points.turn * sums[0] * sums[1] / (1j * scale[:, 0])
    value = Gaussians(((1.0 + 0j, *PAIR),)).field(points, paraxial=True)
    assert relative(value, truth) < 1e-12


def test_the_judges_cells_are_one_in_both_models_far_away():
    rng = np.random.default_rng(2)
    plane = Plane((7, 5), (6e-6, 8e-6), (1e-5, 0.0))
    cells = Cells(plane, (6e-6, 7e-6), rng.normal(size=(7, 5)) + 1j * rng.normal(size=(7, 5)))
    points = Points(*rng.uniform(-2e-5, 2e-5, (2, 9)), np.zeros(9), -0.05, 500e-9)
    both = [cells.field(points, paraxial=paraxial) for paraxial in (False, True)]
    assert relative(both[1], both[0]) < 1e-5


def test_the_judges_cells_are_fine_enough_behind_a_single_one():
    """On the axis of a wide cell, whose only turn is that of its own edges."""
    plane, one = Plane((1, 1), (40e-6, 40e-6)), np.ones((1, 1), dtype=np.complex128)
    points = Points(*np.zeros((3, 1)), 1e-3, 500e-9)
    whole = Cells(plane, plane.pitch, one).field(points, paraxial=False)
    parts = Plane((8, 8), (5e-6, 5e-6), (2.5e-6, 2.5e-6))
    cut = Cells(parts, parts.pitch, np.ones((8, 8), dtype=np.complex128))
    assert relative(whole, cut.field(points, paraxial=False)) < 1e-9
