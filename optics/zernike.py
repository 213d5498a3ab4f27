"""Zernike polynomials over a unit disc, normalised to a root mean square of one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import eval_jacobi

Array = NDArray[np.float64]


def zernike(n: int, m: int, y: Array, x: Array) -> Array:
    """Z(n, m) at points (y, x) in units of the disc's radius, also beyond it.

    n: degree, 0 or more. m: cycles around the axis, from -n to n in steps of two; cosines for
    m >= 0, sines for m < 0, of the angle from x towards y. The radial part is a Jacobi
    polynomial of r², which stays accurate at any degree (Noll 1976, 10.1364/JOSA.66.000207,
    for the normalisation; Born and Wolf 9.2).
    Raises ValueError for an (n, m) that doesn't exist.
    """
    require_zernike(n, m)
    order = abs(m)
    r2 = y * y + x * x
    radial = (-1) ** ((n - order) // 2) * eval_jacobi((n - order) // 2, order, 0, 1 - 2 * r2)
    # r^m cos(m t) and r^m sin(m t) without an angle, which the axis doesn't have.
    power = (x + 1j * y) ** order
    strength = math.sqrt((2 if m else 1) * (n + 1))
    return np.asarray(strength * radial * (power.real if m >= 0 else power.imag))


def require_zernike(n: int, m: int) -> None:
    """Raise ValueError for a degree and a cycle count that don't go together."""
    if n < 0 or abs(m) > n or (n - m) % 2:
        raise ValueError(f"Zernike ({n}, {m}) doesn't exist; m goes from -n to n in steps of two")
