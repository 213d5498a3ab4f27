"""A measured quantity with its standard uncertainty, and the mean of several."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """A measured quantity, and its standard uncertainty in the same unit.

    Parameters
    ----------
    value : float
        The quantity, in SI units or those that its owner says.
    sigma : float
        Its standard uncertainty.
    """

    value: float
    sigma: float

    def __mul__(self, factor: float) -> Measured:
        return Measured(self.value * factor, self.sigma * abs(factor))

    def times(self, other: Measured) -> Measured:
        """Return the product with an independent quantity."""
        sigma = math.hypot(self.sigma * other.value, self.value * other.sigma)
        return Measured(self.value * other.value, sigma)

    @property
    def inverse(self) -> Measured:
        """The inverse, with its uncertainty."""
        return Measured(1 / self.value, self.sigma / self.value**2)

    @property
    def root(self) -> Measured:
        """The square root; 0 for a negative quantity.

        Near 0, the uncertainty is the root of that of the square.
        """
        value = math.sqrt(max(self.value, 0.0))
        return Measured(value, self.sigma / max(2 * value, math.sqrt(self.sigma), 1e-300))


def weighted_mean(values: Array, sigmas: Array) -> Measured:
    """Return the mean of values, (n,), weighted by their uncertainties.

    Where they scatter more than they should, the uncertainty is larger by as much.
    """
    weights = 1 / sigmas**2
    mean = float((weights * values).sum() / weights.sum())
    chi2 = float((weights * (values - mean) ** 2).sum()) / max(len(values) - 1, 1)
    return Measured(mean, math.sqrt(max(chi2, 1.0) / float(weights.sum())))
