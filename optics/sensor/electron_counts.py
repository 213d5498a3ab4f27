"""Compute the probability of each number of electrons in a sensor pixel (shot noise)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ndtr

from optics.sensor.stages import ShotNoise

Numbers = NDArray[np.float64]


def electron_range(mean: float) -> tuple[int, int]:
    """Return the least and most photoelectrons that a sensor pixel may hold, by shot noise.

    Other counts have a negligible probability.
    """
    # Nine standard deviations are enough. The 20 serve few expected electrons.
    reach = 9.0 * math.sqrt(mean) + 20
    return max(0, math.floor(mean - reach)), math.ceil(mean + reach)


def count_probabilities(mean: float, shot: ShotNoise) -> tuple[int, Numbers]:
    """Return a sensor pixel's least photoelectron count, and the probabilities of all counts."""
    first, last = electron_range(mean)
    counts = np.arange(first, last + 1, dtype=np.float64)
    shares = (_rounded_normal if shot == "Gaussian" else _poisson)(mean, counts)
    return first, shares / shares.sum()


def _poisson(mean: float, counts: Numbers) -> Numbers:
    if mean == 0:
        return (counts == 0).astype(np.float64)
    return np.exp(counts * math.log(mean) - mean - gammaln(counts + 1))


def _rounded_normal(mean: float, counts: Numbers) -> Numbers:
    """Compute a sensor pixel's photoelectron probabilities from a rounded normal distribution.

    Negative numbers count as 0.
    """
    if mean == 0:
        return (counts == 0).astype(np.float64)
    spread = mean / math.sqrt(mean + 1 / 12)
    below = ndtr((np.append(counts, counts[-1] + 1) - 0.5 - mean) / spread)
    if counts[0] == 0:
        below[0] = 0.0
    return np.diff(below)
