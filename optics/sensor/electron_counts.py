"""How likely a pixel holds each whole number of electrons."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ndtr

from optics.sensor.stages import ShotNoise

Numbers = NDArray[np.float64]

_MAX_DEVIATIONS = 9.0
"""Standard deviations beyond which no number of electrons counts."""


def electron_range(mean: float) -> tuple[int, int]:
    """First and last number of electrons that counts, for so many expected."""
    reach = _MAX_DEVIATIONS * math.sqrt(mean) + 20
    return max(0, math.floor(mean - reach)), math.ceil(mean + reach)


def count_probabilities(mean: float, shot: ShotNoise) -> tuple[int, Numbers]:
    """The first number of electrons that counts, and how likely it and the next ones are."""
    first, last = electron_range(mean)
    counts = np.arange(first, last + 1, dtype=np.float64)
    shares = (_rounded_normal if shot == "Gaussian" else _poisson)(mean, counts)
    return first, shares / shares.sum()


def _poisson(mean: float, counts: Numbers) -> Numbers:
    if mean == 0:
        return (counts == 0).astype(np.float64)
    return np.exp(counts * math.log(mean) - mean - gammaln(counts + 1))


def _rounded_normal(mean: float, counts: Numbers) -> Numbers:
    """Whole numbers nearest to a normal one; what would be negative counts as none."""
    if mean == 0:
        return (counts == 0).astype(np.float64)
    spread = mean / math.sqrt(mean + 1 / 12)
    below = ndtr((np.append(counts, counts[-1] + 1) - 0.5 - mean) / spread)
    if counts[0] == 0:
        below[0] = 0.0
    return np.diff(below)
