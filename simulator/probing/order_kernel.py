"""Probe where the light of the panel's side orders lands, on a grid of coarse cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from simulator.probing.far_field import FarField

Array = NDArray[np.float64]


def side_order_kernel(
    far: FarField, period: float, cell: float, lowest: int, highest: int, fade: float = 0.0
) -> Array:
    """Return how a probed far field spreads a point's light over side orders of the panel.

    lowest, highest: range of the orders' numbers: of the larger of both along y and x. fade: metres
    over which the order below the lowest fades into it, at most a period. See order_kernel() for
    all else.
    """
    outer = order_kernel(far, period, cell, highest)
    inner = order_kernel(far, period, cell, lowest - 1, min(fade, period))
    outer[_middle(outer, inner)] -= inner
    return outer


def order_kernel(
    far: FarField,
    period: float,
    cell: float,
    highest: int,
    fade: float = 0.0,
    reach: float = math.inf,
) -> Array:
    """Return how a probed far field spreads a point's light over the panel's diffraction orders.

    Parameters
    ----------
    far : FarField
        The far field; all orders are copies of it, times the envelope of one pixel of the panel.
    period : float
        Distance between two orders on the sensor, metres.
    cell : float
        Side of a cell, metres.
    highest : int
        Largest number of an order along y or x.
    fade : float, default 0.0
        Metres over which the outermost orders fade out, half of them in the next ones.
    reach : float, default inf
        Metres to either side beyond which light isn't needed.

    Returns
    -------
    numpy.ndarray
        Share of the point's light in each cell, (cells, cells), with the point's image in the
        middle cell of an odd number.
    """
    half = math.ceil(min((highest + 0.5) * period + fade / 2, reach) / cell)
    along = [
        _cells_of_samples(far, axis, period / cell, highest, half, fade / period) for axis in (0, 1)
    ]
    return _in_cells(far, *along)


def _middle(outer: Array, inner: Array) -> tuple[slice, slice]:
    """Return the part of a probed far field's kernel that a smaller one covers."""
    more = (len(outer) - len(inner)) // 2
    part = slice(more, len(outer) - more)
    return part, part


def cut_kernel(kernel: Array, half: tuple[int, int]) -> Array:
    """Cut a probed far field's kernel to `half` cells (y, x) on each side of its middle."""
    middle = len(kernel) // 2
    y, x = (min(cells, middle) for cells in half)
    return kernel[middle - y : middle + y + 1, middle - x : middle + x + 1]


def _in_cells(far: FarField, down: csr_array, across: csr_array) -> Array:
    """Sum a probed far field's light in cells, by the samples of both axes that belong to each."""
    return np.asarray(across @ (down @ far.light).T).T.astype(np.float64)


def _cells_of_samples(
    far: FarField, axis: int, cells_per_period: float, most: int, half: int, fade: float
) -> csr_array:
    """Return the envelope of each sample of a probed far field in each cell, (cells, samples).

    Every sample stands for one place in each order from -most to most along the axis. fade: share
    of a period over which the outermost orders fade into the next ones.
    """
    samples = far.light.shape[axis]
    last = most + math.ceil(fade / 2)
    orders = np.arange(-last, last + 1)
    places = np.fft.fftfreq(samples) + orders[:, None]
    envelopes = np.stack([far.envelope(axis, int(order)) for order in orders])
    if fade:
        envelopes *= np.clip(0.5 + (most + 0.5 - np.abs(places)) / fade, 0, 1)
    cells = np.rint(places * cells_per_period).astype(np.intp) + half
    inside = (cells >= 0) & (cells <= 2 * half)
    sample = np.broadcast_to(np.arange(samples), cells.shape)
    entries = envelopes[inside].astype(np.float32), (cells[inside], sample[inside])
    return csr_array(entries, shape=(2 * half + 1, samples))
