"""Black level, dark current and noise of a frame without exposure, from dark frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optics.measuring.group_statistics import (
    STEP_VARIANCE,
    SURE_VARIANCE,
    DarkStatistics,
    GroupStatistics,
    noise_below_a_step,
)
from optics.measuring.measured import Measured, fit_line, weighted_mean

_MOST_ZEROS = 1e-3
"""Largest share of dark numbers that may be 0. More, and mean and noise in darkness are cut off."""

_LIMIT_EVENTS = 3.0
"""Changes between frames that are expected where none is seen, at most (95 %, Poisson)."""


@dataclass(frozen=True)
class DarkPoint:
    """Dark frames of one exposure time, over the whole sensor.

    exposure: seconds.
    mean: number, DN.
    mean_sigma: its uncertainty by the pixels' noise.
    variance: temporal, DN².
    variance_sigma: its uncertainty.
    over_pixels: variance of all numbers, DN².
    """

    exposure: float
    mean: float
    mean_sigma: float
    variance: float
    variance_sigma: float
    over_pixels: float


@dataclass(frozen=True)
class DarkSignal:
    """Black level (DN), dark current (DN/s), and the points that tell them."""

    black_level: Measured
    current: Measured
    points: list[DarkPoint]

    @property
    def is_coarse(self) -> bool:
        """Whether the noise is too small for the converter's steps to measure it."""
        return self.points[0].variance - STEP_VARIANCE < SURE_VARIANCE


def fit_dark_signal(groups: Sequence[GroupStatistics]) -> DarkSignal:
    """Fit black level and dark current to the mean numbers of dark frames.

    Raises ValueError if the numbers end at 0, or darkness was taken at one exposure time only.
    """
    points = _dark_points(groups)
    x, y, sigma = (
        np.array([getattr(point, name) for point in points])
        for name in ("exposure", "mean", "mean_sigma")
    )
    line = fit_line(x, y, sigma)
    errors = np.sqrt(np.diag(line.covariance))
    if points[0].variance - STEP_VARIANCE < SURE_VARIANCE:
        # Numbers that hardly change don't tell where between two steps their mean is.
        errors[0] = math.hypot(errors[0], math.sqrt(STEP_VARIANCE))
        errors[1] = math.hypot(errors[1], math.sqrt(2 * STEP_VARIANCE) / float(np.ptp(x)))
    return DarkSignal(
        Measured(line.start, float(errors[0])), Measured(line.slope, float(errors[1])), points
    )


def _dark_points(groups: Sequence[GroupStatistics]) -> list[DarkPoint]:
    """Return the points of all exposure times, from all groups of pixels."""
    points = []
    for same in zip(*(group.dark for group in groups), strict=True):
        zeros = float(np.average([one.zeros for one in same], weights=[o.pixels for o in same]))
        if zeros > _MOST_ZEROS:
            raise ValueError(
                f"{zeros:.1%} of the dark numbers at {same[0].exposure * 1e3:g} ms are 0, where "
                "noise is cut off; raise the camera's black level (offset), and take the frames "
                "again"
            )
        points.append(_dark_point(same))
    if len(points) < 2:
        raise ValueError("darkness was taken at one exposure time; take it at two or more")
    return points


def _dark_point(same: Sequence[DarkStatistics]) -> DarkPoint:
    """Return the point of one exposure time from its groups of pixels."""
    pixels = np.array([one.pixels for one in same], dtype=np.float64)
    counts = np.array([one.count for one in same], dtype=np.float64)
    means = np.array([one.mean for one in same])
    variances = np.array([one.variance for one in same])
    mean = float(np.average(means, weights=pixels))
    variance = float(np.average(variances, weights=counts))
    sigmas = variances * np.sqrt(np.array([one.spread for one in same]) / counts)
    within = float(np.average([one.over_pixels for one in same], weights=pixels))
    between = float(np.average((means - mean) ** 2, weights=pixels))
    # A number that never changes may still be off by less than chance shows.
    floor = 1 / counts.sum()
    return DarkPoint(
        same[0].exposure, mean, math.sqrt(max(variance, floor) / (2 * counts.sum())), variance,
        max(float(np.sqrt((counts**2 * sigmas**2).sum()) / counts.sum()), floor),
        within + between,
    )  # fmt: skip


def temporal_dark_noise(dark: DarkSignal, system_gain: float) -> tuple[Measured, bool]:
    """Return the variance of the read noise, DN², and whether it is only an upper limit.

    The shot noise of the dark current, system_gain (DN per electron) times its mean, is taken off,
    and the rounding of the converter.
    """
    current = max(dark.current.value, 0.0)
    if dark.is_coarse:
        return _noise_below_a_step(dark)
    shot = np.array([system_gain * current * point.exposure for point in dark.points])
    variances, sigmas = (
        np.array([getattr(point, name) for point in dark.points])
        for name in ("variance", "variance_sigma")
    )
    sigmas = np.hypot(sigmas, shot * _relative(dark.current))
    found = weighted_mean(variances - STEP_VARIANCE - shot, sigmas)
    return found, False


def _noise_below_a_step(dark: DarkSignal) -> tuple[Measured, bool]:
    """Return the variance of a read noise of less than a step, DN², and whether it is a limit.

    The shortest exposure tells it, which has the least dark current.
    """
    point = dark.points[0]
    least = _LIMIT_EVENTS / 2 * point.variance_sigma

    def noise_variance(temporal: float) -> float:
        return noise_below_a_step(point.mean, point.over_pixels, temporal) ** 2

    if point.variance <= least:
        return Measured(noise_variance(least), noise_variance(least)), True
    found = noise_variance(point.variance)
    higher = noise_variance(point.variance + point.variance_sigma)
    return Measured(found, abs(higher - found)), False


def _relative(one: Measured) -> float:
    return one.sigma / max(abs(one.value), 1e-300) if one.value > 0 else 0.0
