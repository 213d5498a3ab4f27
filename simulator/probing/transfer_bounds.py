"""Transfer functions by frequency, whatever their direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.caching import byte_limited_cache
from simulator.probing.far_field import radii

Array = NDArray[np.float64]

_BINS = 96

_RINGS = 32 << 20
"""Bytes of rings that are kept: a panel of 1920 x 1080 pixels has 7 MB of them."""


@dataclass(frozen=True, eq=False)
class TransferBounds:
    """H by cycles per metre on the sensor.

    low, high: of each bin; above the last nothing is known. least, mean_square: of |H| over the
    directions, of light as it is. most: of |H|, of any of the lights that may be. max_loss: the
    most that |1 - H| of these is up to a bin.
    """

    low: Array
    high: Array
    mean_square: Array
    least: Array
    most: Array
    max_loss: Array

    def loss_bound(self, frequency: Array) -> Array:
        """|1 - H| at most up to a frequency; 2 beyond what is known."""
        index = np.searchsorted(self.high, frequency)
        return np.append(self.max_loss, 2.0)[index]

    def modulus_bound(self, frequency: Array, spread: float = 1.0) -> Array:
        """|H| at most near a frequency, and for a blur that is wider or narrower by a factor up
        to `spread`; beyond what is known as much as at its end."""
        last = len(self.high) - 1
        first = np.searchsorted(self.high, frequency / spread) - 1
        end = np.searchsorted(self.low, frequency * spread, side="right")
        first, end = np.clip(first, 0, last), np.clip(end, 0, last)
        found = self.most[first]
        for step in range(1, int((end - first).max(initial=0)) + 1):
            found = np.maximum(found, self.most[np.minimum(first + step, end)])
        return found

    def least_between(self, low: Array, high: Array) -> Array:
        return _least(self, self.least, low, high)

    def mean_square_between(self, low: Array, high: Array) -> Array:
        return _least(self, self.mean_square, low, high)


def _least(of: TransferBounds, values: Array, low: Array, high: Array) -> Array:
    """The least value of the bins that a range meets, and of those beside it; 0 where it goes
    beyond the last."""
    found = np.zeros(len(low))
    for k, (a, b) in enumerate(zip(low, high, strict=True)):
        if b > of.high[-1]:
            continue
        first = max(int(np.searchsorted(of.high, a)) - 1, 0)
        last = int(np.searchsorted(of.low, b, side="right")) if b > 0 else 0
        found[k] = values[first : last + 1].min()
    return found


@dataclass(frozen=True, eq=False)
class Rings:
    """Bins of equal radius on the grid of a far field's transfer function."""

    edges: Array
    order: NDArray[np.int32]
    starts: NDArray[np.intp]

    @property
    def bytes(self) -> int:
        return self.order.nbytes

    def least(self, values: NDArray[np.floating]) -> Array:
        return np.minimum.reduceat(values.ravel()[self.order], self.starts).astype(np.float64)

    def most(self, values: NDArray[np.floating]) -> Array:
        return np.maximum.reduceat(values.ravel()[self.order], self.starts).astype(np.float64)

    def mean(self, values: NDArray[np.floating]) -> Array:
        sums = np.add.reduceat(values.ravel()[self.order], self.starts, dtype=np.float64)
        counts = np.diff(np.append(self.starts, len(self.order)))
        return np.asarray(sums / counts)


@byte_limited_cache(_RINGS)
def rings(shape: tuple[int, int]) -> Rings:
    """For a far field of so many samples; edges: cycles per period, of the bins that have any
    entries, frequency 0 the first of them."""
    away = radii(shape).ravel()
    edges = np.geomspace(0.999, min(shape) // 2, _BINS + 1)
    index = np.searchsorted(edges, away)
    order = np.argsort(index, kind="stable").astype(np.int32)
    order = order[index[order] <= _BINS]
    present, starts = np.unique(index[order], return_index=True)
    return Rings(np.concatenate([[0.0], edges])[np.append(present, present[-1] + 1)], order, starts)
