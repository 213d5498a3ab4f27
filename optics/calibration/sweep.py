"""A sweep of grey levels as one region's first orders saw it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.calibration.stripe_law import StripeLaw

Array = NDArray[np.float64]

MIN_LEVELS = 12
"""Levels of a sweep from which a curve can be told."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Light in one region's first orders, level by level.

    low, high: (n,) grey levels of the two stripes of each frame. light: (n,) in any unit.
    noise: (n,) its standard deviation. law: of the stripes that were shown. Raises ValueError
    for arrays that don't go together or hold no numbers.
    """

    low: NDArray[np.int64]
    high: NDArray[np.int64]
    light: Array
    noise: Array
    law: StripeLaw

    def __post_init__(self) -> None:
        given = (self.low, self.high, self.light, self.noise)
        if len({array.shape for array in given}) > 1 or self.low.ndim != 1:
            raise ValueError(
                f"low, high, light and noise are {', '.join(str(a.shape) for a in given)}; give "
                "one value a frame of each"
            )
        levels = len(set(self.high.tolist()))
        if levels < MIN_LEVELS:
            raise ValueError(f"the sweep has {levels} levels; a curve needs {MIN_LEVELS} at least")
        if not (np.isfinite(self.light).all() and (self.noise > 0).all()):
            raise ValueError("light must be finite and its noise positive")

    def select(self, inliers: NDArray[np.bool_]) -> Sweep:
        """Only some of its frames."""
        return Sweep(
            self.low[inliers],
            self.high[inliers],
            self.light[inliers],
            self.noise[inliers],
            self.law,
        )
