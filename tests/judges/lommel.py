"""A judge of a defocused round lens: Lommel's series."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.special
from numpy.typing import NDArray

from judges.pixels import lines_of, on_pixels, scale_of
from judges.sums import Array
from judges.view import View
from judges.wave import turns


def by_lommel(view: View) -> Array:
    """Lommel's series of Bessel functions (Born and Wolf 8.8)"""
    lens, scale = view.lens, scale_of(view)
    radius = float(lens.stop_diameter) / 2
    at_edge = turns(lens, view.distance, view.wavelength, 0, radius)
    u_ = abs(4 * np.pi * float(at_edge))
    v, u, wv, wu = lines_of(view)
    s, place = np.unique(np.hypot(v[:, None], u), return_inverse=True)
    field = np.array([_lommel(u_, 2 * np.pi * radius / scale * each) for each in s])
    density = np.abs(field) ** 2 * np.pi * radius**2 / scale**2
    return on_pixels(view, density[place].reshape(v.size, u.size), wv, wu)


def _lommel(u: float, v: float) -> complex:
    """2 times the integral of exp(i u r² / 2) J0(v r) r dr from 0 to 1, up to a phase."""
    count = int(max(u, v) + 20 * max(u, v) ** (1 / 3)) + 80
    order = np.arange(count)
    bessel = scipy.special.jv(order, v)
    if u > v:
        terms = (v / u) ** order * bessel
        v0, v1 = _alternating(terms, 0), _alternating(terms, 1)
        edge = np.exp(0.5j * (u + v * v / u))
        return complex(2 / u * (1j - edge * (v1 + 1j * v0)))
    terms = (u / v) ** order * bessel
    u1, u2 = _alternating(terms, 1), _alternating(terms, 2)
    return complex(2 / u * (u1 - 1j * u2) * np.exp(0.5j * u))


def _alternating(terms: NDArray[Any], first: int) -> float:
    """Sum over s of (-1)^s times the term first + 2 s."""
    part = terms[first::2]
    return float(np.sum(part * (-1.0) ** np.arange(part.size)))
