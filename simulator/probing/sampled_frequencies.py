"""Sample a picture's spatial frequencies, so that a few represent the whole power spectrum."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics.caching import byte_limited_cache
from optics.formation import rfft2_frequencies
from optics.fourier import rfft_column_weights
from optics.plane import Plane

Array = NDArray[np.float64]
Gain = Callable[[Array], Array]

_BINS = 64  # number of radial frequency bins without that of frequency 0

# Bytes of the caches of bin numbers and of sorted entries. A frame of 2448 x 2048 pixels with its
# margin takes 3 and 12 MB.
_INDICES, _ORDERS = 16 << 20, 32 << 20


@dataclass(frozen=True, eq=False)
class RadialProfile:
    """The power spectrum of a picture by the modulus of the frequency.

    low, high: edges of each bin, cycles per metre; the first bin holds frequency 0 alone.
    power: sum of the squared modulus over a bin, scaled so that all bins add up to the sum of the
        picture's squares over its samples.
    least: the same if the whole bin had the least value of the bin.
    count: number of frequencies in a bin over that of the picture's samples.
    """

    low: Array
    high: Array
    power: Array
    least: Array
    count: Array

    @staticmethod
    def of(spectrum: torch.Tensor, plane: Plane) -> RadialProfile:
        """Sum the power of a spectrum on the plane's rfft2 grid in radial bins."""
        numbers, low, high, count = bins(plane)
        index = numbers.flatten().long()
        # Columns between the first and the last count twice, for their mirror images.
        squared = (spectrum.real.square() + spectrum.imag.square()).double()
        weighed = squared * rfft_column_weights(plane.shape[1])
        samples = plane.shape[0] * plane.shape[1]
        power = torch.bincount(index, weighed.flatten(), minlength=len(low))
        least = torch.full((len(low),), math.inf, dtype=torch.float64)
        least.scatter_reduce_(0, index, squared.flatten(), "amin")
        least = torch.where(torch.isfinite(least), least, torch.zeros_like(least)) * count
        shares = count.numpy() / samples
        return RadialProfile(low, high, power.numpy() / samples, least.numpy() / samples, shares)

    @property
    def norm(self) -> float:
        """Return the L2 norm of the picture over its samples."""
        return math.sqrt(float(self.power.sum()))

    def filtered_norm_bound(self, gain: Gain) -> float:
        """Bound the picture's L2 norm after a filter, by the largest of nine gains in each bin."""
        return math.sqrt(float((self._largest_gain(gain) ** 2 * self.power).sum()))

    def filtered_peak_bound(self, gain: Gain) -> float:
        """Bound every sample of the picture after a filter, as if all frequencies were in phase."""
        return float((self._largest_gain(gain) * np.sqrt(self.count * self.power)).sum())

    def _largest_gain(self, gain: Gain) -> Array:
        steps = np.linspace(0, 1, 9)[:, None]
        return np.asarray(gain(self.low + steps * (self.high - self.low)).max(axis=0))


@byte_limited_cache(_INDICES)
def bins(plane: Plane) -> tuple[torch.Tensor, Array, Array, torch.Tensor]:
    """Return the radial bin of each frequency of the plane's rfft2 grid, with edges and counts.

    These are bin numbers as uint8, lower and upper edges, and numbers of frequencies.
    """
    fy, fx = rfft2_frequencies(plane)
    # The outer edges have a margin, so that every entry belongs to a bin.
    radius = torch.hypot(fy, fx)
    smallest = 1 / max(n * p for n, p in zip(plane.shape, plane.pitch, strict=True))
    largest = math.hypot(*(0.5 / p for p in plane.pitch))
    edges = np.geomspace(0.999 * smallest, 1.001 * max(largest, 2 * smallest), _BINS + 1)
    index = torch.bucketize(radius, torch.from_numpy(edges))
    doubled = rfft_column_weights(plane.shape[1]).double().expand_as(radius)
    count = torch.bincount(index.flatten(), doubled.flatten(), minlength=_BINS + 1)
    low, high = np.concatenate([[0.0], edges[:-1]]), np.concatenate([[0.0], edges[1:]])
    return index.to(torch.uint8), low, high, count


@dataclass(frozen=True, eq=False)
class SampledFrequencies:
    """Frequencies that represent a picture's spectrum, sampled in proportion to their power.

    The number of samples in a ring of the spectrum depends only on its radius. Frequency 0 isn't
    included.
    ky, kx: cycles per metre.
    place: index of each frequency in the flattened rfft2 grid.
    share: factor by which its power must be multiplied to represent its part of the ring.
    """

    ky: Array
    kx: Array
    place: NDArray[np.intp]
    share: Array

    @staticmethod
    def of(squared: torch.Tensor, plane: Plane) -> SampledFrequencies:
        """Sample frequencies that represent a power spectrum.

        Around each ring, the power between neighbouring samples is the same (systematic sampling,
        Cochran 1977). So all directions are represented, and the result isn't random.
        squared: |spectrum|² on the plane's rfft2 grid.
        """
        order, starts = _sort_by_ring(plane)
        power = (squared.double() * rfft_column_weights(plane.shape[1])).flatten().numpy()
        places, shares = [], []
        high = bins(plane)[2]
        for number, (a, b) in enumerate(itertools.pairwise(starts), 1):
            # From 6 frequencies in the innermost ring to 64 in the outermost.
            ring, count = order[a:b], round(6 + (64 - 6) * (high[number] / high[-1]))
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
        """Return one of `step` frequencies, which then represent all of the power."""
        part = slice(step // 2, None, step)
        share = self.share[part] * (len(self.share) / max(len(self.share[part]), 1))
        return SampledFrequencies(self.ky[part], self.kx[part], self.place[part], share)

    def with_aliases(self, plane: Plane) -> SampledFrequencies:
        """Add the frequencies' aliases on the pixel grid.

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
        """Return the power of a picture that each frequency represents.

        Without aliases, it adds up to about the sum of the squares of the picture without its mean.
        squared: |spectrum|² on the plane's rfft2 grid.
        """
        power = (squared * rfft_column_weights(plane.shape[1])).flatten().numpy()[self.place]
        return np.asarray(power * self.share / (plane.shape[0] * plane.shape[1]))


@byte_limited_cache(_ORDERS)
def _sort_by_ring(plane: Plane) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Sort the entries of the plane's rfft2 grid by ring, and within each ring by direction.

    Returns the order, and the index at which each ring except that of frequency 0 begins, followed
    by the end of the last ring.
    """
    index = bins(plane)[0].flatten().numpy()
    fy, fx = rfft2_frequencies(plane)
    angle = torch.atan2(fy, fx).flatten().numpy()
    order = np.lexsort((angle, index)).astype(np.int32)
    return order, np.searchsorted(index[order], np.arange(1, _BINS + 2))
