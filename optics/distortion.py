"""Radial distortion of a lens: image heights off those of a perspective picture."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TABLE, _STEPS = 1025, 4
"""Points from which the inverse begins, and steps of Newton's method that it takes. Chosen: the
first are right to 1e-6, and each step squares that."""


class RadialDistortion:
    """Brown's model: a point at height r is imaged at r (1 + k1 t² + k2 t⁴), t = r / distance.

    coefficients: k1 and k2. distance: from the lens to the sensor in metres, so that k1 and k2 are
    those that OpenCV's calibration finds. Beyond the height at which the image would fold back, it
    stays there. Brown 1971, Close-range camera calibration.
    """

    def __init__(self, coefficients: Sequence[float], distance: float) -> None:
        self.k1, self.k2 = coefficients
        self.distance = distance
        roots = np.roots([5 * self.k2, 3 * self.k1, 1.0])
        folds = [float(one.real) for one in roots if abs(one.imag) < 1e-12 and one.real > 0]
        self.fold = distance * math.sqrt(min(folds)) if folds else math.inf
        """Height in metres of the undistorted point from which on the image folds back."""

    def distorted(self, height: Array) -> Array:
        """Return the heights at which points of undistorted heights are imaged, metres."""
        height = np.minimum(height, self.fold)
        u = (height / self.distance) ** 2
        return np.asarray(height * (1 + self.k1 * u + self.k2 * u**2))

    def undistorted(self, height: Array) -> Array:
        """Return the undistorted heights of points that are imaged at heights in metres."""
        most = float(np.max(height, initial=0.0))
        end = most
        while end < self.fold and self.distorted(np.array(end)) < most:
            end = min(2 * end, self.fold)
        table = np.linspace(0, end, _TABLE)
        found = np.interp(height, self.distorted(table), table)
        for _ in range(_STEPS):
            u = (found / self.distance) ** 2
            slope = np.maximum(1 + 3 * self.k1 * u + 5 * self.k2 * u**2, 1e-3)
            found = np.clip(found - (self.distorted(found) - height) / slope, 0, end)
        return found

    def area_gain(self, height: Array) -> Array:
        """Return how much larger areas at undistorted heights are imaged than without it."""
        u = (np.minimum(height, self.fold) / self.distance) ** 2
        radial = 1 + 3 * self.k1 * u + 5 * self.k2 * u**2
        return np.asarray((1 + self.k1 * u + self.k2 * u**2) * np.maximum(radial, 0))
