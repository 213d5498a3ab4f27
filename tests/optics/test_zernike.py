"""Zernike polynomials against written-out forms, exact fractions and their own algebra."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from optics.zernike import require_zernike_indices, zernike

# Noll 1976, table I, with y and x in place of angles; sines have m < 0.
WRITTEN_OUT = {
    (0, 0): lambda y, x: 1 + 0 * x,
    (1, 1): lambda y, x: 2 * x,
    (1, -1): lambda y, x: 2 * y,
    (2, 0): lambda y, x: math.sqrt(3) * (2 * (x**2 + y**2) - 1),
    (2, 2): lambda y, x: math.sqrt(6) * (x**2 - y**2),
    (2, -2): lambda y, x: math.sqrt(6) * 2 * x * y,
    (3, 1): lambda y, x: math.sqrt(8) * (3 * (x**2 + y**2) - 2) * x,
    (3, -1): lambda y, x: math.sqrt(8) * (3 * (x**2 + y**2) - 2) * y,
    (3, 3): lambda y, x: math.sqrt(8) * (x**3 - 3 * x * y**2),
    (3, -3): lambda y, x: math.sqrt(8) * (3 * x**2 * y - y**3),
    (4, 0): lambda y, x: math.sqrt(5) * (6 * (x**2 + y**2) ** 2 - 6 * (x**2 + y**2) + 1),
    (4, 2): lambda y, x: math.sqrt(10) * (4 * (x**2 + y**2) - 3) * (x**2 - y**2),
    (4, -2): lambda y, x: math.sqrt(10) * (4 * (x**2 + y**2) - 3) * 2 * x * y,
    (4, 4): lambda y, x: math.sqrt(10) * (x**4 - 6 * x**2 * y**2 + y**4),
    (4, -4): lambda y, x: math.sqrt(10) * 4 * x * y * (x**2 - y**2),
}


def all_up_to(degree: int) -> list[tuple[int, int]]:
    return [(n, m) for n in range(degree + 1) for m in range(-n, n + 1, 2)]


def norm(n: int, m: int) -> float:
    return math.sqrt((2 if m else 1) * (n + 1))


def radial(n: int, m: int, r: np.ndarray) -> np.ndarray:
    """Of zernike(): along the x axis all cosines are one."""
    if m > n:
        return np.zeros_like(r)
    return zernike(n, m, np.zeros_like(r), r) / norm(n, m)


def exact_radial(n: int, m: int, r: Fraction) -> float:
    """Born and Wolf 9.2.1 (5), in whole numbers: the sum itself would lose every digit."""
    f, total = math.factorial, Fraction(0)
    for s in range((n - m) // 2 + 1):
        below = f(s) * f((n + m) // 2 - s) * f((n - m) // 2 - s)
        total += Fraction((-1) ** s * f(n - s), below) * r ** (n - 2 * s)
    return float(total)


def test_every_polynomial_up_to_the_fourth_degree_is_written_out():
    assert sorted(WRITTEN_OUT) == all_up_to(4)


@pytest.mark.parametrize(("n", "m"), WRITTEN_OUT)
def test_low_degrees_are_the_written_out_ones(n, m, rng):
    """Beyond the disc too."""
    y, x = rng.uniform(-1.3, 1.3, (2, 200))
    truth = WRITTEN_OUT[n, m](y, x)
    assert np.allclose(zernike(n, m, y, x), truth, atol=1e-13, rtol=1e-13)


def test_all_are_orthonormal_over_the_disc():
    """To the twelfth degree; 14 x 26 nodes are exact for the products' 24th."""
    nodes, weights = np.polynomial.legendre.leggauss(14)
    r, weights = (nodes + 1) / 2, weights / 2
    angle = 2 * math.pi * np.arange(26) / 26
    y, x = np.outer(r, np.sin(angle)).ravel(), np.outer(r, np.cos(angle)).ravel()
    # Mean over the disc: r dr dt / pi.
    share = np.repeat(2 * r * weights / 26, 26)
    values = np.array([zernike(n, m, y, x) for n, m in all_up_to(12)])
    products = (values * share) @ values.T
    assert np.abs(products - np.eye(len(values))).max() <= 1e-13


@pytest.mark.parametrize(("n", "m"), [(7, 3), (40, 0), (40, 2), (40, 22), (40, 40), (61, 1)])
def test_a_high_degree_is_the_exact_sum(n, m):
    shares = [Fraction(k, 64) for k in (0, 1, 5, 20, 37, 50, 61, 63, 64)]
    truth = [exact_radial(n, m, r) for r in shares]
    value = radial(n, m, np.array([float(r) for r in shares]))
    assert np.abs(value - truth).max() <= 1e-12


@pytest.mark.parametrize("m", [0, 2, -2, 17, -17, 40])
def test_around_the_axis_are_cosines_and_sines_from_x_towards_y(m):
    n, r = 40 + m % 2, 0.83
    angle = np.linspace(-3, 3, 50)
    value = zernike(n, m, r * np.sin(angle), r * np.cos(angle))
    cycles = np.cos(m * angle) if m >= 0 else np.sin(-m * angle)
    truth = norm(n, m) * exact_radial(n, abs(m), Fraction(83, 100)) * cycles
    assert np.abs(value - truth).max() <= 1e-12 * norm(n, m)


def test_degrees_up_to_fifty_obey_the_recurrence():
    """R(n, m) + R(n - 2, m) = r (R(n - 1, |m - 1|) + R(n - 1, m + 1)).

    Shakibaei and Paramesran, Opt. Lett. 38, 2487 (2013).
    """
    r = np.linspace(0, 1, 101)
    part = cache(lambda n, m: radial(n, m, r))
    for n in range(2, 51):
        for m in range(n % 2, n + 1, 2):
            left = part(n, m) + part(n - 2, m)
            right = r * (part(n - 1, abs(m - 1)) + part(n - 1, m + 1))
            assert np.abs(left - right).max() <= 1e-12


def test_at_the_edge_every_radial_part_is_one():
    angle = np.linspace(0, 6, 40)
    for n, m in all_up_to(10):
        value = zernike(n, m, np.sin(angle), np.cos(angle))
        truth = norm(n, m) * (np.cos(m * angle) if m >= 0 else np.sin(-m * angle))
        assert np.abs(value - truth).max() <= 1e-12


@pytest.mark.parametrize(("n", "m"), [(40, 0), (40, -18), (101, 1), (200, 0), (200, 200)])
def test_no_degree_leaves_its_bounds_inside_the_disc(n, m):
    r, angle = np.linspace(0, 1, 300), np.linspace(0, 6, 31)[:, None]
    value = zernike(n, m, r * np.sin(angle), r * np.cos(angle))
    assert np.abs(value).max() <= norm(n, m) * (1 + 1e-9)


def test_on_the_axis_only_round_ones_differ_from_zero():
    zero = np.zeros(1)
    for n, m in all_up_to(9):
        truth = 0.0 if m else (-1) ** (n // 2) * math.sqrt(n + 1)
        assert zernike(n, m, zero, zero)[0] == pytest.approx(truth, abs=1e-14)


def test_points_may_be_rows_and_columns():
    y, x = np.linspace(-1, 1, 4)[:, None], np.linspace(-1, 1, 5)[None, :]
    for n, m in ((0, 0), (3, 1), (4, -2)):
        value = zernike(n, m, y, x)
        assert value.shape == (4, 5)
        assert value.dtype == np.float64
        assert np.allclose(value, WRITTEN_OUT[n, m](*np.broadcast_arrays(y, x)), atol=1e-14)


@pytest.mark.parametrize(("n", "m"), [(2, 1), (3, 0), (1, 3), (2, -4), (-1, 1), (-2, 0)])
def test_a_polynomial_that_does_not_exist_is_refused(n, m):
    words = rf"Zernike \({n}, {m}\) doesn't exist; m goes from -n to n in steps of two"
    with pytest.raises(ValueError, match=words):
        zernike(n, m, np.zeros(1), np.zeros(1))
    with pytest.raises(ValueError, match=words):
        require_zernike_indices(n, m)


def test_those_that_exist_are_let_pass():
    for n, m in all_up_to(6):
        require_zernike_indices(n, m)
