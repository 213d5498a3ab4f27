"""Gratings that tell places on a sensor and regions of a panel apart.

A grating of k cycles per panel pixel sends light to k λ z / pitch on the sensor. Vectors are
(y, x) in cycles per panel pixel, y down the rows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SPOT_SEPARATIONS = (8, 6)
"""Line widths between the spots of different regions: what is good, and what is enough."""

_PREFERRED_PERIODS, _FALLBACK_PERIODS = (
    (48, 40, 32, 27, 23, 20, 18, 16, 14, 12, 10),
    (8.7, 7.4, 6.3, 5.3, 4.4),
)
"""Periods in panel pixels: those that are tried first, and those where there is no other way.
Neighbours blur the edges of stripes, and long stripes have few of them."""

_ORDERS = ((1, 1.0), (-1, 1.0), (3, 1 / 3), (-3, 1 / 3))
"""Orders of stripes that are equally wide, and their amplitudes relative to the first."""

_REGISTRATION_GRATINGS = (
    (0.95, 15.0),
    (0.8, 80.0),
    (0.95, 140.0),
    (0.6, 200.0),
    (0.9, 255.0),
    (0.75, 320.0),
)
"""Length, as a share of the longest, and direction in degrees of gratings for a registration:
no turn and no mirror makes them the same again."""


def region_slices(shape: tuple[int, int], regions: tuple[int, int]) -> list[tuple[slice, slice]]:
    """The (rows, columns) of every region of a panel, row by row."""
    if min(regions) < 1 or regions[0] > shape[0] or regions[1] > shape[1]:
        raise ValueError(
            f"regions is {regions}; a panel of {shape[0]}x{shape[1]} pixels has 1x1 to as many "
            "as it has pixels"
        )
    edges = [np.linspace(0, n, count + 1).round() for n, count in zip(shape, regions, strict=True)]
    rows, columns = ([slice(int(a), int(b)) for a, b in itertools.pairwise(e)] for e in edges)
    return [(row, column) for row in rows for column in columns]


def registration_vectors(max_frequency: float) -> Array:
    """Six vectors for a registration, (6, 2), that no turn and no mirror takes to each other.

    max_frequency: cycles per panel pixel, so that the spots fall on the sensor however it is
    turned.
    """
    _require_frequency(max_frequency)
    return np.array(
        [
            (
                share * max_frequency * math.sin(math.radians(angle)),
                share * max_frequency * math.cos(math.radians(angle)),
            )
            for share, angle in _REGISTRATION_GRATINGS
        ]
    )


def region_vectors(
    shape: tuple[int, int], regions: tuple[int, int], max_frequency: float, blur: float = 0.0
) -> Array:
    """A grating vector for every region, (regions, 2), whose spots don't disturb each other.

    Each has whole numbers of cycles in its region, so that it is dark where the others send
    their light: lines of a rectangle are zero at the lattice of their width. Among these the
    vectors are chosen one after the other, each where the tails of all orders of the ones
    before are weakest, with periods as long as that allows. max_frequency: cycles per panel pixel.
    blur: in the same unit, by how much more the spots must be apart because star, lens and sensor
    widen them. Raises ValueError if so many spots can't be told apart.
    """
    _require_frequency(max_frequency)
    count = len(region_slices(shape, regions))
    lines = np.array([shape[0] // regions[0], shape[1] // regions[1]])
    tried = [
        (1 / period, apart)
        for some in (_PREFERRED_PERIODS, _FALLBACK_PERIODS)
        for apart in _SPOT_SEPARATIONS
        for period in some
    ]
    for length, apart in tried:
        chosen = _choose_lattice_points(
            _lattice(lines, min(length, max_frequency)), count, apart + blur * lines
        )
        if len(chosen) == count:
            return np.array(chosen) / lines
    raise ValueError(
        f"regions is {regions}; the spots of {count} gratings can't be told apart on this sensor: "
        "choose fewer regions, or let more of the sensor be read"
    )


def _lattice(lines: NDArray[np.int64], max_frequency: float) -> NDArray[np.int64]:
    """Cycles in a region (y, x) of the vectors up to a length, one of each pair of opposites."""
    most = np.floor(max_frequency * lines).astype(int)
    grid = np.mgrid[-most[0] : most[0] + 1, 0 : most[1] + 1].reshape(2, -1).T
    return grid[np.hypot(*(grid / lines).T) <= max_frequency]


def _choose_lattice_points(
    grid: NDArray[np.int64], count: int, separation: Array
) -> list[NDArray[np.int64]]:
    """Lattice points, as many of `count` as are `separation`, line widths (y, x), from each
    other."""
    # All regions meet in the zeroth order.
    spots, strengths = [np.zeros(2, dtype=np.int64)], [count * math.pi / 2]
    chosen: list[NDArray[np.int64]] = []
    while len(chosen) < count:
        away = np.abs(grid[:, None] - np.array(spots)[None])
        # From the spots before, and from its own on the other side.
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
    """Grey levels, (rows, columns): stripes of two levels, equally wide, in every region.

    vectors: of the regions, row by row.
    """
    grey = np.empty(shape, dtype=np.uint8)
    for (rows, columns), vector in zip(region_slices(shape, regions), vectors, strict=True):
        y = np.arange(rows.stop - rows.start)[:, None] + 0.5
        x = np.arange(columns.stop - columns.start)[None, :] + 0.5
        turns = vector[0] * y + vector[1] * x
        # A boundary on a pixel's centre belongs to the stripe behind it, whatever rounding says.
        upper = np.floor(2 * turns + 1e-9) % 2 == 1
        grey[rows, columns] = np.where(upper, high, low)
    return grey


def blazed_grating_phase(shape: tuple[int, int], vector: Sequence[float]) -> Array:
    """The phase in radians of a blazed grating, (rows, columns), zero at the panel's centre."""
    rows, columns = shape
    y = (np.arange(rows) - rows // 2)[:, None]
    x = (np.arange(columns) - columns // 2)[None, :]
    return 2 * math.pi * (vector[0] * y + vector[1] * x)


def max_grating_frequency(
    shape: tuple[int, int], sensor_pitch: float, panel_pitch: float, scale: float
) -> float:
    """Cycles per panel pixel of the steepest grating whose light surely falls on the sensor.

    shape: (rows, columns) of the sensor. Pitches in metres. scale: wavelength times the
    distance from lens to sensor, in square metres. Three quarters of the shorter half side
    leave room for a star off the centre, and for a sensor that is turned. At most a quarter:
    steeper gratings are no stripes any more.
    """
    half = 0.75 * min(shape) / 2 * sensor_pitch
    return min(half * panel_pitch / scale, 0.25)


def _require_frequency(max_frequency: float) -> None:
    if not 0 < max_frequency <= 0.25:
        raise ValueError(
            f"max_frequency is {max_frequency:g} cycles per pixel; it must be positive and at "
            "most 0.25"
        )
