"""Measure a camera's characteristics from its frames alone, after EMVA 1288 release 4 (linear)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.integer]
Array = NDArray[np.float64]

_ROUNDING = 1 / 12
"""Variance of rounding to whole numbers, DN²."""


@dataclass(frozen=True)
class TransferPoint:
    """A point of the photon transfer curve, from two frames of even light.

    exposure: seconds. mean: less the dark mean, DN. variance: temporal, less the dark variance,
    DN².
    """

    exposure: float
    mean: float
    variance: float


@dataclass(frozen=True)
class Characteristics:
    """Holds the characteristics of a sensor that are measured from pairs of frames.

    gain: electrons per digital number (1/K). read_noise: electrons, temporal, in darkness at
    the shortest exposure. dark_current: electrons per second. saturation_capacity: electrons at
    which the variance is largest. linearity_error: mean absolute deviation from the best line,
    relative. rate: electrons per second from the light. points: the photon transfer curve.
    """

    gain: float
    read_noise: float
    dark_current: float
    saturation_capacity: float
    linearity_error: float
    rate: float
    points: tuple[TransferPoint, ...]


@dataclass(frozen=True)
class Uniformity:
    """Holds a sensor's PRNU (relative) and DSNU (electrons), standard deviations over pixels."""

    prnu: float
    dsnu: float


def pair_moments(first: Frame, second: Frame) -> tuple[float, float]:
    """Compute mean and temporal variance of two sensor frames (EMVA 1288, section 6.4).

    Both frames show the same scene. The variance is half the variance of their difference, which
    contains no fixed pattern. Raises ValueError unless both frames have the same shape, and two
    pixels or more.
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if a.shape != b.shape or a.size < 2:
        raise ValueError(f"frames of {a.shape} and {b.shape} are given; give two of one shape")
    difference = a - b
    return float((a.mean() + b.mean()) / 2), float(
        ((difference**2).mean() - difference.mean() ** 2) / 2
    )


def measure_characteristics(
    illuminated: Mapping[float, tuple[Frame, Frame]], dark: Mapping[float, tuple[Frame, Frame]]
) -> Characteristics:
    """Measure a sensor's gain, noise, dark current and linearity (EMVA 1288).

    illuminated: pairs of frames in even, constant light, by exposure time in seconds. dark: pairs
    without light, of the same exposure times. Raises ValueError for fewer than five exposure times,
    or if they differ between light and darkness.
    """
    exposures = sorted(illuminated)
    if exposures != sorted(dark):
        raise ValueError("light and darkness have other exposures; take each in both")
    if len(exposures) < 5:
        raise ValueError(f"{len(exposures)} exposures are given; a curve needs five or more")
    darkness = [(t, *pair_moments(*dark[t])) for t in exposures]
    points = tuple(_point(t, illuminated[t], mean, variance) for t, mean, variance in darkness)
    full = max(points, key=lambda point: point.variance)
    # Section 6.6 of EMVA 1288 fits the photon transfer curve up to 70 % of saturation.
    slope = _photon_transfer_slope([p for p in points if p.mean <= 0.7 * full.mean])
    gain = 1 / slope
    noise = max(darkness[0][2] - _ROUNDING, 0.0)
    times, means = np.array(exposures), np.array([mean for _, mean, _ in darkness])
    rate, error = _linearity(points, full.mean)
    return Characteristics(
        gain=gain,
        read_noise=gain * math.sqrt(noise),
        dark_current=gain * float(np.polyfit(times, means, 1)[0]),
        saturation_capacity=gain * full.mean,
        linearity_error=error,
        rate=gain * rate,
        points=points,
    )


def _point(
    exposure: float, pair: tuple[Frame, Frame], dark_mean: float, dark_variance: float
) -> TransferPoint:
    """Return a sensor's photon transfer point at an exposure, with the dark moments subtracted."""
    mean, variance = pair_moments(*pair)
    return TransferPoint(exposure, mean - dark_mean, variance - dark_variance)


def _photon_transfer_slope(points: Sequence[TransferPoint]) -> float:
    """Fit the slope of a sensor's photon transfer curve (EMVA 1288, section 6.6).

    The curve is a line through zero. The error of each variance is proportional to the variance, so
    the fit uses relative residuals.
    """
    used = [p for p in points if p.mean > 0]
    if len(used) < 2:
        raise ValueError(
            "fewer than two exposures are below saturation and above darkness; take more between"
        )
    means = np.array([p.mean for p in used])
    variances = np.array([p.variance for p in used])
    weights = 1 / means**2
    return float((weights * means * variances).sum() / (weights * means**2).sum())


def _linearity(points: Sequence[TransferPoint], full: float) -> tuple[float, float]:
    """Fit a sensor's mean signal over exposure time: slope and linearity error.

    The method is that of EMVA 1288, section 6.7. Slope and error both use relative residuals of the
    points from 5 to 95 % of saturation.
    """
    used = [p for p in points if 0.05 * full <= p.mean <= 0.95 * full]
    if len(used) < 3:
        raise ValueError(
            "fewer than three exposures lie between 5 and 95 % of saturation; take more"
        )
    times, means = np.array([p.exposure for p in used]), np.array([p.mean for p in used])
    slope, offset = np.polyfit(times, means, 1, w=1 / means)
    line = offset + slope * times
    return float(slope), float(np.abs((means - line) / line).mean())


def uniformity(half_full: Sequence[Frame], dark: Sequence[Frame], gain: float) -> Uniformity:
    """Measure a sensor's PRNU and DSNU from half-saturated and dark frames (EMVA 1288, section 8).

    The frames are averaged. The temporal noise that remains in the average is measured and
    subtracted. The light must be even. gain: electrons per digital number. Raises ValueError for
    fewer than two frames of either kind, or if the light isn't brighter than darkness.
    """
    light, light_variance = _mean_and_spatial_variance(half_full)
    darkness, dark_variance = _mean_and_spatial_variance(dark)
    above = float(light.mean() - darkness.mean())
    if above <= 0:
        raise ValueError(f"the lit frames are {above:g} numbers above the dark; light the sensor")
    prnu = math.sqrt(max(light_variance - dark_variance, 0.0)) / above
    return Uniformity(prnu, gain * math.sqrt(max(dark_variance, 0.0)))


def _mean_and_spatial_variance(frames: Sequence[Frame]) -> tuple[Array, float]:
    """Return a sensor's average frame, and the variance over its pixels without temporal noise."""
    count = len(frames)
    if count < 2:
        raise ValueError(f"{count} frames are given; the temporal noise of one is unknown")
    total = np.zeros(np.shape(frames[0]))
    squares = np.zeros_like(total)
    for frame in frames:
        values = np.asarray(frame, dtype=np.float64)
        total += values
        squares += values**2
    mean = total / count
    temporal = float(((squares - count * mean**2) / (count - 1)).mean())
    return mean, float(mean.var(ddof=1)) - temporal / count
