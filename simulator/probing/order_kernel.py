"""Probe where the light of the panel's side orders lands, on a grid of coarse cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from simulator.probing.far_field import FarField

Array = NDArray[np.float64]


def side_order_kernel(
    far: FarField, period: float, cell: float, lowest: int, highest: int
) -> Array:
    """Return how a probed far field spreads a point's light over side orders of the panel.

    Parameters
    ----------
    far : FarField
        The far field; all orders are copies of it, times the envelope of one pixel of the panel.
    period : float
        Distance between two orders on the sensor, metres.
    cell : float
        Side of a cell, metres.
    lowest, highest : int
        Range of the orders' numbers: of the larger of both along y and x.

    Returns
    -------
    numpy.ndarray
        Share of the point's light in each cell, (cells, cells), with the point's image in the
        middle cell of an odd number.
    """
    half = math.ceil((highest + 0.5) * period / cell)
    outer, inner = (
        [_cells_of_samples(far, axis, period / cell, most, half) for axis in (0, 1)]
        for most in (highest, lowest - 1)
    )
    return np.asarray(_in_cells(far, *outer) - _in_cells(far, *inner))


def cut_kernel(kernel: Array, half: tuple[int, int]) -> Array:
    """Cut a probed far field's kernel to `half` cells (y, x) on each side of its middle."""
    middle = len(kernel) // 2
    y, x = (min(cells, middle) for cells in half)
    return kernel[middle - y : middle + y + 1, middle - x : middle + x + 1]


def _in_cells(far: FarField, down: csr_array, across: csr_array) -> Array:
    """Sum a probed far field's light in cells, by the samples of both axes that belong to each."""
    return np.asarray(across @ (down @ far.light).T).T.astype(np.float64)


def _cells_of_samples(
    far: FarField, axis: int, cells_per_period: float, most: int, half: int
) -> csr_array:
    """Return the envelope of each sample of a probed far field in each cell, (cells, samples).

    Every sample stands for one place in each order from -most to most along the axis.
    """
    samples = far.light.shape[axis]
    orders = np.arange(-most, most + 1)
    places = np.fft.fftfreq(samples) + orders[:, None]
    cells = np.rint(places * cells_per_period).astype(np.intp) + half
    entries = (
        np.concatenate([far.envelope(axis, int(order)) for order in orders]).astype(np.float32),
        (cells.ravel(), np.tile(np.arange(samples), len(orders))),
    )
    return csr_array(entries, shape=(2 * half + 1, samples))
