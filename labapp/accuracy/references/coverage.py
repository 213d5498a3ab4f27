"""How much of each cell of a grid a stop leaves open, by quadrature over heights."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_legendre

from labapp.accuracy.references.lens_integral import (
    break_heights,
    open_intervals,
    sample_positions,
    vertical_line_crossings,
)
from optics.plane import Plane
from optics.stop.aperture import Stop

Array = NDArray[np.float64]

_NODES = 12
"""Between two breaks, where what is open is smooth in the cosine of an angle."""


def open_area_shares(stop: Stop, radius: float, plane: Plane) -> Array:
    """Share of every cell around a plane's samples that a stop leaves open.

    Parameters
    ----------
    stop
        Its shapes are in units of `radius`.
    radius
        Metres.
    plane
        Samples in the middles of the cells, which are as large as its pitch.

    Returns
    -------
    Array
        (rows, columns), 0 to 1, within 1e-9 for stops of circles and straight edges.
    """
    (top, left), (height, width) = _edges(plane, radius), plane.pitch
    area = np.zeros(plane.shape)
    low, high = break_heights(stop)[0], break_heights(stop)[-1]
    met = [y for x in left for y in vertical_line_crossings(stop, float(x))]
    breaks = sorted({*break_heights(stop), *met, *(y for y in top if low < y < high)})
    nodes, weights = roots_legendre(_NODES)
    angles = nodes * np.pi / 2
    for low, high in pairwise(breaks):
        if high - low < 1e-13:
            continue
        # A circle's chord grows as a root of the height from where it begins: smooth in the angle.
        heights = (low + high) / 2 + (high - low) / 2 * np.sin(angles)
        shares = weights * np.pi / 2 * (high - low) / 2 * np.cos(angles)
        row = int(np.searchsorted(top, (low + high) / 2)) - 1
        if 0 <= row < plane.shape[0]:
            for y, share in zip(heights, shares, strict=True):
                area[row] += share * _open_lengths(stop, float(y), left)
    return area * radius**2 / (height * width)


def _edges(plane: Plane, radius: float) -> tuple[Array, Array]:
    """Where cells begin and end along y and x, in stop radii."""
    found = []
    for axis in (0, 1):
        middles, half = sample_positions(plane, axis), plane.pitch[axis] / 2
        found.append(np.append(middles - half, middles[-1] + half) / radius)
    return found[0], found[1]


def _open_lengths(stop: Stop, height: float, left: Array) -> Array:
    """Of a line at a height, in every cell."""
    length = np.zeros(left.size - 1)
    for low, high in open_intervals(stop, height):
        length += np.clip(np.minimum(high, left[1:]) - np.maximum(low, left[:-1]), 0, None)
    return length
