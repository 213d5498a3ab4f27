"""Hold the light of a sweep of grey levels in one region's first diffraction orders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.calibration.stripe_law import StripeLaw

Array = NDArray[np.float64]

MIN_LEVELS = 12
"""Fewest levels of a sweep from which a phase curve can be fitted; chosen."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Hold the light of one region's first orders in a sweep, frame by frame.

    low, high: (n,) grey levels of the two stripes of each frame. light: (n,) in any unit.
    noise: (n,) standard deviation of the light. law: that of the displayed stripes. Raises
    ValueError for arrays of different shapes, for too few levels, and for light or noise that
    isn't valid.
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
        """Return the calibration sweep with its inlier frames only."""
        return Sweep(
            self.low[inliers],
            self.high[inliers],
            self.light[inliers],
            self.noise[inliers],
            self.law,
        )
