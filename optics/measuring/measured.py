"""A measured quantity with its standard uncertainty, and what is computed from several."""

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
        return Measured(
            self.value * other.value,
            math.hypot(self.sigma * other.value, self.value * other.sigma),
        )

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


@dataclass(frozen=True)
class Line:
    """A straight line through points: value at 0 and slope, and how well it fits.

    covariance: (2, 2), of both.
    chi2: mean squared residual per degree of freedom, in variances.
    """

    start: float
    slope: float
    covariance: Array
    chi2: float


def fit_line(x: Array, y: Array, sigmas: Array) -> Line:
    """Fit a straight line to points of known uncertainty, all (n,).

    Where they scatter more than they should, the covariance is larger by as much.
    """
    design = np.stack([np.ones_like(x), x], axis=1) / sigmas[:, None]
    # Times of milliseconds and numbers of thousands are brought to the same size.
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.inv((design / scale).T @ (design / scale)) / np.outer(scale, scale)
    start, slope = inverse @ design.T @ (y / sigmas)
    left = (y - start - slope * x) / sigmas
    chi2 = float((left**2).sum()) / max(len(x) - 2, 1)
    return Line(float(start), float(slope), inverse * max(chi2, 1.0), chi2)
