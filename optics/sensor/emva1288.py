"""A camera's own figures from its frames alone, as EMVA 1288 release 4 (linear) measures them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.integer]
Array = NDArray[np.float64]

_ROUNDING = 1 / 12
"""Variance of rounding to whole numbers."""

_TRANSFER_LIMIT = 0.7
"""Of the saturation's mean, up to which the photon transfer curve is fitted (section 6.6)."""

_LINEARITY_FROM, _LINEARITY_TO = 0.05, 0.95
"""Of the same, between which linearity is judged (section 6.7)."""


@dataclass(frozen=True)
class TransferPoint:
    """Two frames of even light: their mean less the dark mean, and their temporal variance less
    the dark variance, in digital numbers. exposure: seconds."""

    exposure: float
    mean: float
    variance: float


@dataclass(frozen=True)
class Characteristics:
    """What is found.

    gain: electrons per digital number (1/K). read_noise: electrons, temporal, in darkness at
    the shortest exposure. dark_current: electrons per second. saturation_capacity: electrons at
    which the variance is largest. linearity_error: mean absolute deviation from the best line,
    relative. rate: electrons per second of the light. points: the photon transfer curve.
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
    """prnu: relative. dsnu: electrons, in darkness. Both are standard deviations of pixels."""

    prnu: float
    dsnu: float


def pair_moments(first: Frame, second: Frame) -> tuple[float, float]:
    """Mean and temporal variance of two frames of the same (section 6.4): the variance is half
    of their difference's, so that no fixed pattern is in it.

    Raises ValueError unless both have one shape, and two pixels or more.
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
    """Gain, noise, dark current and linearity, from pairs of frames.

    illuminated, dark: by exposure in seconds, the same ones for both; even, constant light, and
    none. Raises ValueError for fewer than five exposures, or other ones in darkness.
    """
    exposures = sorted(illuminated)
    if exposures != sorted(dark):
        raise ValueError("light and darkness have other exposures; take each in both")
    if len(exposures) < 5:
        raise ValueError(f"{len(exposures)} exposures are given; a curve needs five or more")
    darkness = [(t, *pair_moments(*dark[t])) for t in exposures]
    points = tuple(_point(t, illuminated[t], mean, variance) for t, mean, variance in darkness)
    full = max(points, key=lambda point: point.variance)
    slope = _photon_transfer_slope([p for p in points if p.mean <= _TRANSFER_LIMIT * full.mean])
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
    mean, variance = pair_moments(*pair)
    return TransferPoint(exposure, mean - dark_mean, variance - dark_variance)


def _photon_transfer_slope(points: Sequence[TransferPoint]) -> float:
    """The photon transfer curve's slope (section 6.6). Each variance is known to a share of
    itself, so that all points count alike by ratio: the curve is a line through zero."""
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
    """Slope of the mean by exposure, and the mean deviation from the line, both by relative
    residuals (section 6.7)."""
    used = [p for p in points if _LINEARITY_FROM * full <= p.mean <= _LINEARITY_TO * full]
    if len(used) < 3:
        raise ValueError(
            "fewer than three exposures lie between 5 and 95 % of saturation; take more"
        )
    times, means = np.array([p.exposure for p in used]), np.array([p.mean for p in used])
    slope, offset = np.polyfit(times, means, 1, w=1 / means)
    line = offset + slope * times
    return float(slope), float(np.abs((means - line) / line).mean())


def uniformity(half_full: Sequence[Frame], dark: Sequence[Frame], gain: float) -> Uniformity:
    """PRNU and DSNU from frames at half of saturation, and as many dark ones (section 8).

    Frames are averaged; what their temporal noise leaves in the average is subtracted by its
    own measure. The light must be even. gain: electrons per digital number. Raises ValueError
    for fewer than two frames of either, or a light that isn't above darkness.
    """
    light, light_variance = _mean_and_spatial_variance(half_full)
    darkness, dark_variance = _mean_and_spatial_variance(dark)
    above = float(light.mean() - darkness.mean())
    if above <= 0:
        raise ValueError(f"the lit frames are {above:g} numbers above the dark; light the sensor")
    prnu = math.sqrt(max(light_variance - dark_variance, 0.0)) / above
    return Uniformity(prnu, gain * math.sqrt(max(dark_variance, 0.0)))


def _mean_and_spatial_variance(frames: Sequence[Frame]) -> tuple[Array, float]:
    """The average frame, and the variance over its pixels without what is temporal."""
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
