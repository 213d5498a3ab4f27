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


class CountProbabilities:
    """Probabilities of a sensor pixel's photoelectron counts, for means between two.

    least, most: the means. shot: the distribution. Logarithms of factorials are computed once for
    all means.
    """

    def __init__(self, least: float, most: float, shot: ShotNoise) -> None:
        self._shot, self.first = shot, electron_range(least)[0]
        self.counts = np.arange(self.first, electron_range(most)[1] + 1, dtype=np.float64)
        self._log_factorials = gammaln(self.counts + 1)

    def __call__(self, means: Numbers) -> tuple[slice, Numbers]:
        """Return which counts pixels may hold, as a slice of `counts`, and their probabilities.

        means: rising. The probabilities are (means, counts), for few means that are close together.
        """
        first, last = electron_range(float(means[0]))[0], electron_range(float(means[-1]))[1]
        part = slice(first - self.first, last + 1 - self.first)
        counts, lit = self.counts[part], means[:, None] > 0
        mean = np.where(lit, means[:, None], 1.0)
        if self._shot == "Gaussian":
            shares = _rounded_normal(mean, counts)
        else:
            shares = np.exp(counts * np.log(mean) - mean - self._log_factorials[part])
        shares = np.where(lit, shares, counts == 0)
        return part, shares / shares.sum(axis=1, keepdims=True)


def _rounded_normal(mean: Numbers, counts: Numbers) -> Numbers:
    """Compute sensor pixels' photoelectron probabilities from rounded normal distributions.

    Negative numbers count as 0. mean: (means, 1).
    """
    spread = mean / np.sqrt(mean + 1 / 12)
    below = ndtr((np.append(counts, counts[-1] + 1) - 0.5 - mean) / spread)
    if counts[0] == 0:
        below[:, 0] = 0.0
    return np.diff(below, axis=1)
