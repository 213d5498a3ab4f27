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
from optics.camera.stop import Stop
from optics.plane import Plane

Array = NDArray[np.float64]


def open_area_shares(stop: Stop, radius: float, plane: Plane) -> Array:
    """Return the share of each sample's cell that a stop leaves open, (rows, columns), 0 to 1.

    It is within 1e-9 for stops of circles and straight edges.
    stop: shapes in units of `radius`.
    radius: of the stop, metres.
    plane: its samples are the centres of the cells; a cell is as large as the pitch.
    """
    (top, left), (height, width) = _edges(plane, radius), plane.pitch
    area = np.zeros(plane.shape)
    low, high = break_heights(stop)[0], break_heights(stop)[-1]
    met = [y for x in left for y in vertical_line_crossings(stop, float(x))]
    breaks = sorted({*break_heights(stop), *met, *(y for y in top if low < y < high)})
    # Twelve nodes between two break heights: there the open length is smooth in the angle below.
    nodes, weights = roots_legendre(12)
    angles = nodes * np.pi / 2
    for low, high in pairwise(breaks):
        if high - low < 1e-13:
            continue
        # The chord of a circle grows as the square root of the height above its lowest point,
        # which is smooth in the angle.
        heights = (low + high) / 2 + (high - low) / 2 * np.sin(angles)
        shares = weights * np.pi / 2 * (high - low) / 2 * np.cos(angles)
        row = int(np.searchsorted(top, (low + high) / 2)) - 1
        if 0 <= row < plane.shape[0]:
            for y, share in zip(heights, shares, strict=True):
                area[row] += share * _open_lengths(stop, float(y), left)
    return area * radius**2 / (height * width)


def _edges(plane: Plane, radius: float) -> tuple[Array, Array]:
    """Return the cells' edges along y and x, in stop radii."""
    found = []
    for axis in (0, 1):
        middles, half = sample_positions(plane, axis), plane.pitch[axis] / 2
        found.append(np.append(middles - half, middles[-1] + half) / radius)
    return found[0], found[1]


def _open_lengths(stop: Stop, height: float, left: Array) -> Array:
    """Return the open length of a horizontal line at `height` in every cell, in stop radii."""
    length = np.zeros(left.size - 1)
    for low, high in open_intervals(stop, height):
        length += np.clip(np.minimum(high, left[1:]) - np.maximum(low, left[:-1]), 0, None)
    return length
