"""Define the error bounds of effects in electrons, and the norms that they are relative to."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Bound:
    """The largest change of a picture if an effect is below its finest level.

    The bound holds for any levels of the other effects.

    Parameters
    ----------
    mean : float
        L2 norm over the sensor's pixels of the change of the mean picture, electrons.
    variance : float
        L2 norm of the change of the variance map, electrons².
    sigma : float
        L2 norm of the change of the map of standard deviations, electrons.
    shape : float
        Largest Kolmogorov distance between the cumulative distributions of a pixel, 0 to 1, for an
        effect that changes neither mean nor variance.
    how : str
        How the bound was found: "proved: …" or "audited ×2: …".

    Raises
    ------
    ValueError
        If a number is negative or NaN.

    Examples
    --------
    >>> total = Bound(mean=2.0).plus(Bound(mean=1.0, variance=4.0))
    >>> total.mean, total.variance
    (3.0, 4.0)
    """

    mean: float = 0.0
    variance: float = 0.0
    sigma: float = 0.0
    shape: float = 0.0
    how: str = "proved: nothing changes"

    def __post_init__(self) -> None:
        for name in ("mean", "variance", "sigma", "shape"):
            value = getattr(self, name)
            if not value >= 0:
                raise ValueError(f"{name} is {value}; a bound is 0 or more")

    def plus(self, other: Bound) -> Bound:
        """Add two error bounds of an effect plan; the sum bounds both changes together."""
        return Bound(
            self.mean + other.mean,
            self.variance + other.variance,
            self.sigma + other.sigma,
            self.shape + other.shape,
            self.how,
        )

    def minus(self, other: Bound) -> Bound:
        """Return by how much an effect plan's error bound exceeds another, 0 at least."""
        return Bound(
            max(self.mean - other.mean, 0.0),
            max(self.variance - other.variance, 0.0),
            max(self.sigma - other.sigma, 0.0),
            max(self.shape - other.shape, 0.0),
            self.how,
        )


@dataclass(frozen=True)
class MinimumNorms:
    """Lower bounds of the norms of a picture with every effect; errors are relative to them.

    Parameters
    ----------
    mean : float
        L2 norm of the mean picture over the sensor's pixels, electrons; 0 if nothing is known.
    variance : float
        L2 norm of the variance map, electrons²; 0 if nothing is known.
    sigma : float
        L2 norm of the map of standard deviations, electrons; 0 if nothing is known.

    Examples
    --------
    >>> MinimumNorms(mean=100.0, variance=50.0, sigma=10.0).relative_error(Bound(mean=2.0))
    0.02
    """

    mean: float
    variance: float
    sigma: float

    def relative_error(self, bound: Bound) -> float:
        """Return the largest relative error of a bound in an effect plan.

        The error is infinite for a change where a norm is 0.
        """
        return max(
            ratio(bound.mean, self.mean),
            ratio(bound.variance, self.variance),
            ratio(bound.sigma, self.sigma),
            bound.shape,
        )


def ratio(change: float, whole: float) -> float:
    """Return a planned effect's change over the picture's norm; infinite for a norm of 0."""
    if change == 0:
        return 0.0
    return change / whole if whole > 0 else math.inf
