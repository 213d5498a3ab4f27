"""How much a picture changes at most, in electrons, and what that is relative to."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Bound:
    """What an effect at some level changes against its finest, at most, whatever the others are.

    mean: L2 norm over the sensor's pixels of the change of the mean picture, electrons.
    variance: the same of the variance map, electrons². sigma: of the map of standard deviations,
    electrons. shape: largest distance of a pixel's cumulative distributions (Kolmogorov's), for
    what changes neither mean nor variance. how: "proved: …" or "audited ×2: …".
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
        """Both changes together: what each is at most whatever the other does adds up."""
        return Bound(
            self.mean + other.mean,
            self.variance + other.variance,
            self.sigma + other.sigma,
            self.shape + other.shape,
            self.how,
        )

    def minus(self, other: Bound) -> Bound:
        """What is left to be spent of this when that has been; never below nothing."""
        return Bound(
            max(self.mean - other.mean, 0.0),
            max(self.variance - other.variance, 0.0),
            max(self.sigma - other.sigma, 0.0),
            max(self.shape - other.shape, 0.0),
            self.how,
        )


@dataclass(frozen=True)
class MinimumNorms:
    """Lower bounds of what a picture with every effect has, which errors are relative to.

    mean, variance, sigma: L2 norms as in Bound; 0 where nothing is known to be there.
    """

    mean: float
    variance: float
    sigma: float

    def relative_error(self, bound: Bound) -> float:
        """The worst of a bound's relative errors; infinite where something changes nothing."""
        return max(
            ratio(bound.mean, self.mean),
            ratio(bound.variance, self.variance),
            ratio(bound.sigma, self.sigma),
            bound.shape,
        )


def ratio(change: float, whole: float) -> float:
    """A change over what it is relative to; infinite where something changes nothing."""
    if change == 0:
        return 0.0
    return change / whole if whole > 0 else math.inf
