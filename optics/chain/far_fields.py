"""Compute the fields of a chain's panel pixels that lie many Fresnel zones beside their targets."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]

FAR_ZONES = 6.0
"""Distance from a pixel's edge, in Fresnel zones, from which the series here holds to rounding."""

_BLOCK = 8192
"""Numbers in an array that stays in the processor's cache."""


def far_fields(place: Array, line: Array, side: float, area: float) -> Waves:
    """Return the fields along an axis that far pixels of a chain send to places, (places, pixels).

    They are those of `cell_kernel`, as the difference of the waves from both edges of a pixel. At a
    distance t from an edge, in units of sqrt(area), its wave is

        exp(i pi t²) / (2 pi t) (i + v - 3 i v² - 15 v³ + ...),  v = 1 / (2 pi t²)

    (Abramowitz and Stegun 7.3.27 and 7.3.28), over sqrt(i). With x0 the middle of the places and s0
    a pixel near to it, the phase (x - s)² is (x0 - s)² + 2 (x - x0) (x0 - s0) + (x - x0)² and
    2 (x - x0) (s0 - s); only the last one isn't a sum of functions of x and of s, and pixels are
    evenly spaced, so a product of two phasors has it. No large phases are subtracted.

    place: metres, (places,). line: evenly spaced centres of pixels, metres, all at least FAR_ZONES
    plus half a pixel away, on one side or on both. side: of a pixel, metres. area: Fresnel area in
    m².
    """
    found = np.empty((len(place), len(line)), dtype=np.complex128)
    if not found.size:
        return found
    unit = math.sqrt(area)
    place, line, half = place / unit, line / unit, side / unit / 2
    middle = (place.min() + place.max()) / 2
    aside = place - middle
    near = line[np.abs(line - middle).argmin()]
    # A table of phasors has all steps for some pixels, and a coarse one has the rest.
    steps = math.ceil(math.sqrt(len(line)))
    fine = _phasor(2 * aside[:, None] * (line[0] - line[:steps]))
    coarse = _phasor(2 * aside[:, None] * (near - line[::steps]))
    edges = (half, -half)
    down = [_phasor(aside**2 + 2 * aside * (middle - near - edge))[:, None] for edge in edges]
    along = [_phasor((middle - line - edge) ** 2 - 0.25) for edge in edges]
    some = max(1, _BLOCK // len(place) // steps)
    for start in range(0, coarse.shape[1], some):
        both = coarse[:, start : start + some, None] * fine[:, None, :]
        part = slice(start * steps, (start + some) * steps)
        columns = line[part]
        shared = both.reshape(len(place), -1)[:, : len(columns)]
        first, second = (
            _edge_waves(place, columns + edge) * along[k][part] * down[k]
            for k, edge in enumerate(edges)
        )
        np.multiply(shared, first - second, out=found[:, part])
    return found


def _phasor(half_turns: Array) -> Waves:
    angle = math.pi * (half_turns - 2 * np.round(half_turns / 2))
    return np.asarray(np.cos(angle) + 1j * np.sin(angle))


def _edge_waves(place: Array, edge: Array) -> Waves:
    """Return the waves from the edges of a chain's pixels, without their phasors; see far_fields().

    place, edge: in units of sqrt(area).
    """
    inverse = 1 / (2 * math.pi * np.subtract.outer(place, edge))
    v = 2 * math.pi * inverse * inverse
    square = v * v
    # Double factorials 1, 1, 3, 15, 105, ... with the signs of powers of -1 for either part.
    factors = [1]
    nearest = float(v.max())
    while factors[-1] * nearest ** (len(factors) - 1) > 1e-17 and len(factors) < 40:
        factors.append(factors[-1] * (2 * len(factors) - 1))
    signed = [factor * (-1) ** (k // 2) for k, factor in enumerate(factors)]
    wave = np.empty(inverse.shape, dtype=np.complex128)
    np.multiply(_polynomial(signed[::2], square), inverse, out=wave.imag)
    v *= inverse
    np.multiply(_polynomial(signed[1::2], square), v, out=wave.real)
    return wave


def _polynomial(factors: list[int], at: Array) -> Array:
    total = np.full_like(at, factors[-1])
    for factor in factors[-2::-1]:
        total *= at
        total += factor
    return total
