"""Probe the power spectrum of a picture by spatial frequency, in radial bins."""

from __future__ import annotations

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

BINS = 64
"""Number of radial frequency bins without that of frequency 0."""

_INDICES = 16 << 20
"""Bytes of the cache of bin numbers. A frame of 2448 x 2048 pixels with its margin takes 3 MB."""

Gain = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class RadialProfile:
    """The power spectrum of a picture by the modulus of the frequency.

    low, high: edges of each bin, cycles per metre; the first bin holds frequency 0 alone. power:
    sum of the squared modulus over a bin, scaled so that all bins add up to the sum of the
    picture's squares over its samples. least: the same if the whole bin had the least value of the
    bin. count: number of frequencies in a bin over that of the picture's samples.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    power: NDArray[np.float64]
    least: NDArray[np.float64]
    count: NDArray[np.float64]

    @staticmethod
    def of(spectrum: torch.Tensor, plane: Plane) -> RadialProfile:
        """Compute the radial profile of a probed picture's power from its spectrum.

        spectrum: on the plane's rfft2 grid.
        """
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
        """Return the L2 norm of the probed picture over its samples."""
        return math.sqrt(float(self.power.sum()))

    def filtered_norm_bound(self, gain: Gain) -> float:
        """Bound the L2 norm of the probed picture after a filter with the given gain.

        gain: function of cycles per metre, not negative. Within each bin, its largest value at nine
        frequencies is used.
        """
        return math.sqrt(float((self._largest_gain(gain) ** 2 * self.power).sum()))

    def filtered_peak_bound(self, gain: Gain) -> float:
        """Bound every sample of the probed picture after a filter with the given gain.

        All frequencies are taken to be in phase.
        """
        return float((self._largest_gain(gain) * np.sqrt(self.count * self.power)).sum())

    def _largest_gain(self, gain: Gain) -> NDArray[np.float64]:
        steps = np.linspace(0, 1, 9)[:, None]
        return np.asarray(gain(self.low + steps * (self.high - self.low)).max(axis=0))

    def plus(self, other: RadialProfile) -> RadialProfile:
        """Add the power spectra of two probed pictures, as if they were uncorrelated."""
        return RadialProfile(
            self.low, self.high, self.power + other.power, self.least + other.least, self.count
        )


@byte_limited_cache(_INDICES)
def bins(
    plane: Plane,
) -> tuple[torch.Tensor, NDArray[np.float64], NDArray[np.float64], torch.Tensor]:
    """Return the radial bin of each frequency of a probed picture, with edges and counts.

    The frequencies are the entries of the plane's rfft2 grid. The result is (bin numbers as uint8,
    lower edges, upper edges, numbers of frequencies).
    """
    fy, fx = rfft2_frequencies(plane)
    # The outer edges have a margin, so that every entry belongs to a bin.
    radius = torch.hypot(fy, fx)
    smallest = 1 / max(n * p for n, p in zip(plane.shape, plane.pitch, strict=True))
    largest = math.hypot(*(0.5 / p for p in plane.pitch))
    edges = np.geomspace(0.999 * smallest, 1.001 * max(largest, 2 * smallest), BINS + 1)
    index = torch.bucketize(radius, torch.from_numpy(edges))
    doubled = rfft_column_weights(plane.shape[1]).double().expand_as(radius)
    count = torch.bincount(index.flatten(), doubled.flatten(), minlength=BINS + 1)
    low, high = np.concatenate([[0.0], edges[:-1]]), np.concatenate([[0.0], edges[1:]])
    return index.to(torch.uint8), low, high, count
