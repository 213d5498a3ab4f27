"""Gratings that distinguish positions on the sensor and regions of the panel.

A grating of k cycles per panel pixel sends light to k λ z / pitch on the sensor. Grating vectors
are (y, x) in cycles per panel pixel, with y down the rows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Panel pixels; the coupling of neighbouring pixels blurs the edges of stripes
_PREFERRED_PERIODS = (48, 40, 32, 27, 23, 20, 18, 16, 14, 12, 10)
_FALLBACK_PERIODS = (8.7, 7.4, 6.3, 5.3, 4.4)  # panel pixels, tried last
# Diffraction orders of equally wide stripes, and their amplitudes relative to the first
_ORDERS = ((1, 1.0), (-1, 1.0), (3, 1 / 3), (-3, 1 / 3))

_REGISTRATION_LENGTHS = (0.95, 0.8, 0.95, 0.6, 0.9, 0.75)
# Lengths, as shares of the longest, and directions in degrees of the registration's gratings. No
# rotation and no reflection maps this set onto itself.
_REGISTRATION_ANGLES = (15.0, 80.0, 140.0, 200.0, 255.0, 320.0)


def region_slices(shape: tuple[int, int], regions: tuple[int, int]) -> list[tuple[slice, slice]]:
    """Return the slices (rows, columns) of every region of the panel, row by row."""
    if min(regions) < 1 or regions[0] > shape[0] or regions[1] > shape[1]:
        raise ValueError(
            f"regions is {regions}; a panel of {shape[0]}x{shape[1]} pixels has 1x1 to as many "
            "as it has pixels"
        )
    edges = [np.linspace(0, n, count + 1).round() for n, count in zip(shape, regions, strict=True)]
    rows, columns = ([slice(int(a), int(b)) for a, b in itertools.pairwise(e)] for e in edges)
    return list(itertools.product(rows, columns))


def registration_vectors(max_frequency: float) -> Array:
    """Return six grating vectors that register panel and sensor, (6, 2).

    max_frequency: cycles per panel pixel, low enough for the spots to fall on the sensor in any
        orientation.
    """
    _require_frequency(max_frequency)
    polar = zip(_REGISTRATION_LENGTHS, map(math.radians, _REGISTRATION_ANGLES), strict=True)
    found = [(s * max_frequency * math.sin(a), s * max_frequency * math.cos(a)) for s, a in polar]
    return np.array(found)


def region_vectors(
    shape: tuple[int, int], regions: tuple[int, int], max_frequency: float, blur: float = 0.0
) -> Array:
    """Choose one grating vector per region, (regions, 2), so that spots don't overlap.

    Each vector has whole numbers of cycles in its region. A region's light is then dark where the
    other regions send theirs, because the line shape of a rectangle is zero at all other points of
    this lattice. The vectors are chosen one after the other, each where the tails of all orders of
    the previous ones are weakest, with periods as long as possible.

    max_frequency: cycles per panel pixel.
    blur: in the same unit, additional distance between spots because star, lens and sensor widen
        them.

    Raises ValueError if the sensor has no room for so many separate spots.
    """
    _require_frequency(max_frequency)
    count = len(region_slices(shape, regions))
    lines = np.array([shape[0] // regions[0], shape[1] // regions[1]])
    for periods in (_PREFERRED_PERIODS, _FALLBACK_PERIODS):
        # 8 line widths between spots are preferred, 6 are enough.
        for apart, period in itertools.product((8, 6), periods):
            # The vectors up to a length, (y, x) cycles per region, one of each opposite pair.
            most = np.floor(min(1 / period, max_frequency) * lines).astype(int)
            grid = np.mgrid[-most[0] : most[0] + 1, 0 : most[1] + 1].reshape(2, -1).T
            grid = grid[np.hypot(*(grid / lines).T) <= min(1 / period, max_frequency)]
            chosen = _choose_lattice_points(grid, count, apart + blur * lines)
            if len(chosen) == count:
                return np.array(chosen) / lines
    raise ValueError(
        f"regions is {regions}; the spots of {count} gratings can't be told apart on this sensor: "
        "choose fewer regions, or let more of the sensor be read"
    )


def _choose_lattice_points(
    grid: NDArray[np.int64], count: int, separation: Array
) -> list[NDArray[np.int64]]:
    """Choose up to `count` grating vectors whose spots lie apart from each other.

    separation: least distance in line widths, (y, x).
    """
    # The zeroth order gets light from all regions, so it is the first spot to avoid.
    spots, strengths = [np.zeros(2, dtype=np.int64)], [count * math.pi / 2]
    chosen: list[NDArray[np.int64]] = []
    while len(chosen) < count:
        away = np.abs(grid[:, None] - np.array(spots)[None])
        # A spot must be apart from the previous ones, and from its own opposite order.
        free = (away >= separation).any(-1).all(1) & (np.abs(2 * grid) >= separation).any(1)
        if not free.any():
            break
        tails = np.array(strengths) / np.maximum(1, math.pi * away).prod(-1)
        cost = np.where(free, (tails**2).sum(1), np.inf)
        best = grid[int(np.argmin(cost))]
        chosen.append(best)
        spots += [order * best for order, _ in _ORDERS]
        strengths += [amplitude for _, amplitude in _ORDERS]
    return chosen


def stripe_pattern(
    shape: tuple[int, int], regions: tuple[int, int], vectors: Array, low: int, high: int
) -> NDArray[np.uint8]:
    """Draw equally wide stripes of two grey levels in every region, (rows, columns).

    vectors: grating vectors of the regions, row by row.
    """
    grey = np.empty(shape, dtype=np.uint8)
    for (rows, columns), vector in zip(region_slices(shape, regions), vectors, strict=True):
        y = np.arange(rows.stop - rows.start)[:, None] + 0.5
        x = np.arange(columns.stop - columns.start)[None, :] + 0.5
        turns = vector[0] * y + vector[1] * x
        # A pixel whose centre is on a boundary belongs to the stripe behind it. The small term
        # keeps rounding errors from deciding this.
        upper = np.floor(2 * turns + 1e-9) % 2 == 1
        grey[rows, columns] = np.where(upper, high, low)
    return grey


def blazed_grating_phase(shape: tuple[int, int], vector: Sequence[float]) -> Array:
    """Compute the phase of a blazed grating in radians, (rows, columns), 0 at the panel's centre.

    vector: (y, x) in cycles per panel pixel.
    """
    rows, columns = shape
    y = (np.arange(rows) - rows // 2)[:, None]
    x = (np.arange(columns) - columns // 2)[None, :]
    return 2 * math.pi * (vector[0] * y + vector[1] * x)


def max_grating_frequency(
    shape: tuple[int, int], sensor_pitch: float, panel_pitch: float, scale: float
) -> float:
    """Compute the highest frequency whose light surely falls on the sensor, cycles per panel pixel.

    shape: (rows, columns) of the sensor.
    sensor_pitch, panel_pitch: metres.
    scale: wavelength times the distance from lens to sensor, in square metres.

    The light goes to at most three quarters of the shorter half side, which leaves room for a star
    off the centre and for a rotated sensor. The frequency is at most 0.25, because steeper gratings
    aren't stripes any more.
    """
    half = 0.75 * min(shape) / 2 * sensor_pitch
    return min(half * panel_pitch / scale, 0.25)


def _require_frequency(max_frequency: float) -> None:
    if not 0 < max_frequency <= 0.25:
        raise ValueError(
            f"max_frequency is {max_frequency:g} cycles per pixel; it must be positive and at "
            "most 0.25"
        )
