"""Sample a picture's spatial frequencies, so that a few represent the whole power spectrum."""

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

_ORDERS = 32 << 20
"""Bytes of the cache of sorted entries. A frame of 2448 x 2048 pixels with margin takes 12 MB."""


@dataclass(frozen=True, eq=False)
class SampledFrequencies:
    """Frequencies that represent a picture's spectrum, sampled in proportion to their power.

    The number of samples in a ring of the spectrum depends only on its radius. ky, kx: cycles per
    metre. place: index of each frequency in the flattened rfft2 grid. share: factor by which its
    power must be multiplied to represent its part of the ring. Frequency 0 isn't included.
    """

    ky: Array
    kx: Array
    place: NDArray[np.intp]
    share: Array

    @staticmethod
    def of(squared: torch.Tensor, plane: Plane) -> SampledFrequencies:
        """Sample frequencies that represent the power spectrum of a probed picture.

        squared: |spectrum|² on the plane's rfft2 grid. Around each ring, the power between
        neighbouring samples is the same (systematic sampling, Cochran 1977). So all directions are
        represented, and the result isn't random.
        """
        order, starts = _sort_by_ring(plane)
        power = (squared.double() * rfft_column_weights(plane.shape[1])).flatten().numpy()
        places, shares = [], []
        high = bins(plane)[2]
        for number, (a, b) in enumerate(itertools.pairwise(starts), 1):
            ring, count = order[a:b], _frequencies_per_ring(high[number] / high[-1])
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

    def every(self, step: int) -> SampledFrequencies:
        """Return one of `step` sampled frequencies of a probed picture, for all of its power."""
        part = slice(step // 2, None, step)
        share = self.share[part] * (len(self.share) / max(len(self.share[part]), 1))
        return SampledFrequencies(self.ky[part], self.kx[part], self.place[part], share)

    def with_aliases(self, plane: Plane) -> SampledFrequencies:
        """Add to a probed picture's sampled frequencies their aliases on the pixel grid.

        An alias is one sampling frequency away along either axis. Its power is assumed to be the
        same as that of the sampled frequency, apart from the pixel's transfer function.
        """
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
        """Return the power of a probed picture that each sampled frequency represents.

        Without aliases, the powers add up to about the sum of the squares of the picture without
        its mean, over its samples.
        """
        power = (squared * rfft_column_weights(plane.shape[1])).flatten().numpy()[self.place]
        return np.asarray(power * self.share / (plane.shape[0] * plane.shape[1]))


def _frequencies_per_ring(radius: float) -> int:
    """Return how many frequencies sample a ring of a probed picture's spectrum.

    radius: the ring's, relative to the outermost. The number grows from 6 for the innermost ring to
    64 for the outermost.
    """
    return round(6 + (64 - 6) * radius)


@byte_limited_cache(_ORDERS)
def _sort_by_ring(plane: Plane) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Sort a probed spectrum's entries by ring, and within each ring by direction.

    The entries are those of the plane's rfft2 grid.

    Returns the order, and the index at which each ring except that of frequency 0 begins, followed
    by the end of the last ring.
    """
    index = bins(plane)[0].flatten().numpy()
    fy, fx = rfft2_frequencies(plane)
    angle = torch.atan2(fy, fx).flatten().numpy()
    order = np.lexsort((angle, index)).astype(np.int32)
    return order, np.searchsorted(index[order], np.arange(1, BINS + 2))
