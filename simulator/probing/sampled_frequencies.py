"""Some of a picture's frequencies that stand for all of them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics.caching import byte_limited_cache
from optics.formation import rfft2_frequencies
from optics.fourier import rfft_column_weights
from optics.plane import Plane
from simulator.probing.radial import BINS, bins

Array = NDArray[np.float64]

_LEAST, _MOST = 6, 64
"""Frequencies of the innermost ring of a picture's spectrum, and of the outermost, where most
is to be told apart; in between they grow with the radius."""

_ORDERS = 32 << 20
"""Bytes of orders that are kept: a frame of 2448 x 2048 pixels with its margin has 12 MB."""


@dataclass(frozen=True, eq=False)
class SampledFrequencies:
    """As many of every ring of a picture's spectrum, the more likely the more power they have.

    ky, kx: cycles per metre. place: of each in a flattened rfft2 grid. share: by which its power
    has to be multiplied, to stand for its ring's. Frequency 0 isn't among them.
    """

    ky: Array
    kx: Array
    place: NDArray[np.intp]
    share: Array

    @staticmethod
    def of(squared: torch.Tensor, plane: Plane) -> SampledFrequencies:
        """squared: |spectrum|² on the plane's rfft2 grid.

        Around each ring, they lie evenly by the power between them (systematic sampling, Cochran
        1977): none of its directions is left out, and chance has no part in it.
        """
        order, starts = _around(plane)
        power = (squared.double() * rfft_column_weights(plane.shape[1])).flatten().numpy()
        places, shares = [], []
        high = bins(plane)[2]
        for number, (a, b) in enumerate(itertools.pairwise(starts), 1):
            ring, count = order[a:b], _count(high[number] / high[-1])
            sums = power[ring].cumsum()
            if not len(ring) or not sums[-1] > 0:
                continue
            wanted = (np.arange(count) + 0.5) / count * sums[-1]
            found = ring[np.minimum(np.searchsorted(sums, wanted), len(ring) - 1)]
            places.append(found)
            shares.append(sums[-1] / count / power[found])
        place = np.concatenate([np.zeros(0, dtype=np.intp), *places])
        fy, fx = (one.numpy() for one in rfft2_frequencies(plane))
        y, x = np.divmod(place, fx.shape[1])
        return SampledFrequencies(fy[y, 0], fx[0, x], place, np.concatenate([np.zeros(0), *shares]))

    def with_aliases(self, plane: Plane) -> SampledFrequencies:
        """With those that look alike on pixels, one and the same step of their grid beyond along
        either axis: of detail that is no stronger there, but for what pixels make of it."""
        steps = [1 / pitch for pitch in plane.pitch]
        y, x = (k - np.copysign(step, k) for k, step in zip((self.ky, self.kx), steps, strict=True))
        dim_y, dim_x = (
            (np.sinc(far / step) / np.sinc(k / step)) ** 2
            for far, k, step in zip((y, x), (self.ky, self.kx), steps, strict=True)
        )
        return SampledFrequencies(
            np.concatenate([self.ky, y, self.ky]),
            np.concatenate([self.kx, self.kx, x]),
            np.tile(self.place, 3),
            np.concatenate([self.share, self.share * dim_y, self.share * dim_x]),
        )

    def represented_power(self, squared: torch.Tensor, plane: Plane) -> Array:
        """What each stands for of a spectrum: those of the plane's grid add up to about the sum of
        the picture's squares over its samples, without its mean."""
        power = (squared * rfft_column_weights(plane.shape[1])).flatten().numpy()[self.place]
        return np.asarray(power * self.share / (plane.shape[0] * plane.shape[1]))


def _count(radius: float) -> int:
    """Frequencies of a ring of some radius, relative to that of the outermost."""
    return round(_LEAST + (_MOST - _LEAST) * radius)


@byte_limited_cache(_ORDERS)
def _around(plane: Plane) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Entries of a plane's rfft2 grid, ring by ring and within each by their direction, and where
    each ring but that of frequency 0 begins, and the last ends."""
    index = bins(plane)[0].flatten().numpy()
    fy, fx = rfft2_frequencies(plane)
    angle = torch.atan2(fy, fx).flatten().numpy()
    order = np.lexsort((angle, index)).astype(np.int32)
    return order, np.searchsorted(index[order], np.arange(1, BINS + 2))
