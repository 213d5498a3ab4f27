"""Bounds of a pattern's transfer functions by frequency, over all directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.caching import byte_limited_cache
from simulator.probing.far_field import radii

Array = NDArray[np.float64]

_RINGS = 32 << 20  # bytes of the cache of rings. A panel of 1920 x 1080 pixels takes 7 MB.


@dataclass(frozen=True, eq=False)
class TransferBounds:
    """Bounds of the transfer function H of a pattern, in bins of the frequency on the sensor.

    low, high: edges of each bin, cycles per metre; nothing is known above the last.
    least, mean_square: least |H| and mean of |H|² over the directions, for the light of the pattern
        from where it is blurred most; largest_mean_square: from where it is blurred least.
    most: largest |H| of any light that may reach the sensor.
    max_loss: largest |1 - H| of any such light at all frequencies up to a bin.
    """

    low: Array
    high: Array
    mean_square: Array
    largest_mean_square: Array
    least: Array
    most: Array
    max_loss: Array

    def loss_bound(self, frequency: Array) -> Array:
        """Bound ``|1 - H|`` at all frequencies up to the given ones; 2 beyond the last bin."""
        index = np.searchsorted(self.high, frequency)
        return np.append(self.max_loss, 2.0)[index]

    def modulus_bound(self, frequency: Array, spread: float = 1.0) -> Array:
        """Bound ``|H|`` near frequencies; spread: factor by which the blur may be wider."""
        return largest_near(self.low, self.high, self.most, frequency, spread)

    def least_between(self, low: Array, high: Array) -> Array:
        """Return the least ``|H|`` of the pattern's light in each range of frequencies."""
        return self._least(self.least, low, high)

    def mean_square_near(self, frequency: Array) -> Array:
        """Estimate the mean of ``|H|²`` over the directions, at frequencies.

        It is from where light is blurred least: what stands there also hides light of others by its
        sharp edges. Beyond the last bin, the last value is used.
        """
        index = np.searchsorted(self.high, frequency)
        return self.largest_mean_square[np.minimum(index, len(self.high) - 1)]

    def mean_square_between(self, low: Array, high: Array) -> Array:
        return self._least(self.mean_square, low, high)

    def _least(self, values: Array, low: Array, high: Array) -> Array:
        """Return the least value of the bins that each range touches, neighbours included.

        The value is 0 for a range beyond the last bin.
        """
        found = np.zeros(len(low))
        for k, (a, b) in enumerate(zip(low, high, strict=True)):
            if b <= self.high[-1]:
                first = max(int(np.searchsorted(self.high, a)) - 1, 0)
                last = int(np.searchsorted(self.low, b, side="right")) if b > 0 else 0
                found[k] = values[first : last + 1].min()
        return found


def largest_near(low: Array, high: Array, values: Array, frequency: Array, spread: float) -> Array:
    """Return the largest of the values in the bins near each frequency.

    Beyond the last bin, the last value is used.
    low, high: edges of the bins.
    spread: factor by which a bin may be off the frequency.
    """
    last = len(high) - 1
    first = np.searchsorted(high, frequency / spread) - 1
    end = np.searchsorted(low, frequency * spread, side="right")
    first, end = np.clip(first, 0, last), np.clip(end, 0, last)
    found = values[first]
    for step in range(1, int((end - first).max(initial=0)) + 1):
        found = np.maximum(found, values[np.minimum(first + step, end)])
    return found


@dataclass(frozen=True, eq=False)
class Rings:
    """Radial bins on the grid of a far field's transfer function."""

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
    """Return the radial bins of a far field's transfer function.

    The edges are in cycles per period. Empty bins are left out, and the first bin is frequency 0.
    shape: samples of the far field.
    """
    away = radii(shape).ravel()
    bins = 96
    edges = np.geomspace(0.999, min(shape) // 2, bins + 1)
    index = np.searchsorted(edges, away)
    order = np.argsort(index, kind="stable").astype(np.int32)
    order = order[index[order] <= bins]
    present, starts = np.unique(index[order], return_index=True)
    return Rings(np.concatenate([[0.0], edges])[np.append(present, present[-1] + 1)], order, starts)
