"""Gain, saturation and linearity of a camera, from noise and signal over exposure time.

The slope of the photon transfer curve, temporal variance over signal, is the gain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from optics.measuring.group_statistics import (
    STEP_VARIANCE,
    SURE_VARIANCE,
    GroupStatistics,
    LightStatistics,
)
from optics.measuring.measured import Array, Measured, weighted_mean

# Of the largest: below it, read noise is left, and all pixels are full; chosen
_FULL_VARIANCE = 0.1
_AT_TOP = 0.5  # numbers from the converter's end within which a saturated mean is its end


def find_clip_level(
    groups: Sequence[GroupStatistics], top_number: int
) -> tuple[Measured, Literal["converter", "well"]] | tuple[None, None]:
    """Return the number at which pixels clip, DN, and what ends there; None if none saturates.

    Raises ValueError if numbers exceed the converter's end as it is said to be.
    """
    most = max(one.brightest for group in groups for one in group.light)
    if most > top_number:
        raise ValueError(
            f"frames have numbers up to {most:g}, and the converter is said to end at "
            f"{top_number}; correct the sensor's bits or clip level"
        )
    full = []
    for light in (group.light for group in groups):
        largest = _noisiest(light)
        limit = _FULL_VARIANCE * light[largest].variance
        full += [one for one in light[largest + 1 :] if one.variance < limit + one.dark.variance]
    if not full:
        return None, None
    means = np.array([one.mean for one in full])
    # A converter's end has no noise. Its numbers are whole.
    sigmas = np.array([math.sqrt(max(one.variance, 1e-6) / (2 * one.count)) for one in full])
    number = weighted_mean(means, sigmas)
    is_top = number.value > top_number - _AT_TOP
    if is_top or np.mean([one.variance for one in full]) < SURE_VARIANCE:
        # Rounding hides where between two steps the end is.
        number = Measured(number.value, math.hypot(number.sigma, math.sqrt(STEP_VARIANCE)))
    return number, "converter" if is_top else "well"


def _noisiest(light: Sequence[LightStatistics]) -> int:
    """Return the index of the exposure with the largest variance."""
    return max(range(len(light)), key=lambda number: light[number].variance)


def _is_open(one: LightStatistics, full: float | None, share: float) -> bool:
    """Tell whether a group of pixels is below a share of saturation, a signal in DN, if any.

    The brightest pixel must be clear of clipping, too, which counts where light is uneven.
    """
    if full is None:
        return True
    dark = one.mean - one.signal
    return one.signal <= share * full and one.brightest - dark <= (1 + share) / 2 * full


def saturation_signal(groups: Sequence[GroupStatistics]) -> Measured | None:
    """Return the signal at which the variance is largest, DN (EMVA 1288, section 6.6).

    It is known to the spacing of the exposures. None if the variance still rises at the longest.
    The groups that are lit as the middle one is tell it.
    """
    found = []
    for light in (group.light for group in groups):
        largest = _noisiest(light)
        if largest < len(light) - 1:
            here, below = light[largest].signal, light[max(largest - 1, 0)].signal
            step = max(here - below, light[largest + 1].signal - here)
            found.append((here, step / math.sqrt(12)))
    return Measured(*np.median(found, axis=0).tolist()) if found else None


FIT_SHARE = 0.7
"""Share of saturation up to which the curve is fitted (EMVA 1288, section 6.6)."""

# The third changes the gain by less than 1e-6; a drift of a fifth is then right to 1e-4
_PASSES = 4
_FEWEST = 3  # exposure times that are fitted, at least


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """The photon transfer curve and its fit.

    system_gain: K, DN per electron.
    offset: what the dark number is too large by, DN, where the converter's steps are too coarse to
        tell it; 0 otherwise.
    covariance: (2, 2), of both.
    chi2: mean squared residual per degree of freedom.
    signal, variance, sigma: points, DN, DN² and the variance's uncertainty, (n,).
    exposure: of each, seconds.
    used: whether the fit uses it.
    """

    system_gain: Measured
    offset: Measured
    covariance: Array
    chi2: float
    freedom: int
    signal: Array
    variance: Array
    sigma: Array
    exposure: Array
    used: NDArray[np.bool_]


def fit_photon_transfer(
    groups: Sequence[GroupStatistics], full: float | None, coarse: Measured | None
) -> PhotonTransfer:
    """Fit a photon transfer curve through zero to all groups of pixels.

    full: signal at which pixels clip, DN; None if none does.
    coarse: variance of the dark noise, DN², where the dark numbers don't show it. The dark number
        is then uncertain by a part of a step, and is fitted too.

    Weights are those that the fit predicts, since measured ones would favour what is low by chance.
    Raises ValueError if too few exposures are below saturation.
    """
    points = [one for group in groups for one in group.light]
    signal = np.array([one.signal for one in points])
    is_sure = [coarse is None or one.variance - STEP_VARIANCE > SURE_VARIANCE for one in points]
    is_open = [one.signal > 0 and _is_open(one, full, FIT_SHARE) for one in points]
    used = np.array(is_sure) & np.array(is_open)
    exposure = np.array([one.exposure for one in points])
    if len(set(exposure[used])) < _FEWEST:
        raise ValueError(
            f"{len(set(exposure[used]))} exposure times are above darkness and below "
            f"{FIT_SHARE:.0%} of saturation, and the fit needs {_FEWEST} or more; take shorter "
            "ones, or dim the light"
        )
    dark = np.array([one.dark.variance for one in points])
    if coarse is not None:
        dark = np.full(len(points), STEP_VARIANCE + coarse.value)
    variance = np.array([one.variance for one in points]) - dark
    gain, offset = float(variance[used].sum() / signal[used].sum()), 0.0
    for _ in range(_PASSES):
        sigma = _uncertainties(points, gain, offset, coarse)
        gain, offset, covariance = _fit(
            signal[used], variance[used], sigma[used], coarse is not None
        )
    left = (variance - gain * (signal + offset))[used] / sigma[used]
    freedom = int(used.sum()) - (1 if coarse is None else 2)
    chi2 = float((left**2).sum()) / max(freedom, 1)
    covariance = covariance * max(chi2, 1.0)
    if coarse is not None:
        # An error of the dark noise raises or lowers the whole line.
        covariance[1, 1] += (coarse.sigma / gain) ** 2
    errors = np.sqrt(np.diag(covariance)).tolist()
    return PhotonTransfer(
        Measured(gain, errors[0]), Measured(offset, errors[1]), covariance,
        chi2, freedom, signal, variance, sigma, exposure, used,
    )  # fmt: skip


def electrons(transfer: PhotonTransfer, signal: Measured) -> Measured:
    """Return the electrons of a signal, DN, above the measured dark number."""
    gain, offset = transfer.system_gain.value, transfer.offset.value
    value = (signal.value + offset) / gain
    slopes = np.array([-value / gain, 1 / gain])
    variance = float(slopes @ transfer.covariance @ slopes) + (signal.sigma / gain) ** 2
    return Measured(value, math.sqrt(variance))


def _uncertainties(
    points: Sequence[LightStatistics], gain: float, offset: float, coarse: Measured | None
) -> Array:
    """Return the uncertainties of the points, variances less dark variances, DN²."""
    found = []
    for one in points:
        dark = one.dark.variance if coarse is None else STEP_VARIANCE + coarse.value
        expected = max(gain * (one.signal + offset), 0.0) + dark
        own = expected * math.sqrt(one.spread / one.count)
        shared = dark * math.sqrt(one.dark.spread / one.dark.count) if coarse is None else 0.0
        # The mean's noise moves a point along the line.
        along = gain * math.sqrt(expected / (2 * one.count) + dark / (2 * one.dark.count))
        found.append(math.sqrt(own**2 + shared**2 + along**2))
    return np.array(found)


def _fit(x: Array, y: Array, sigma: Array, with_offset: bool) -> tuple[float, float, Array]:
    """Return slope and offset of the curve, and their covariance."""
    if not with_offset:
        information = float((x**2 / sigma**2).sum())
        slope = float((x * y / sigma**2).sum()) / information
        return slope, 0.0, np.diag([1 / information, 0.0])
    design = np.stack([x, np.ones_like(x)], axis=1) / sigma[:, None]
    covariance = np.linalg.inv(design.T @ design)
    slope, start = covariance @ design.T @ (y / sigma)
    offset = start / slope
    # The offset is start over slope.
    to_offset = np.array([[1.0, 0.0], [-offset / slope, 1 / slope]])
    return float(slope), float(offset), to_offset @ covariance @ to_offset.T


# Shares of saturation between which linearity is judged (EMVA 1288, section 6.7)
_LOW, _HIGH = 0.05, 0.95
_LINEARITY_FEWEST = 4  # exposure times from which linearity is told
# Correlation of exposure and clock that hides a drift; chosen: rising exposures have .95
_ALIKE = 0.9


@dataclass(frozen=True, eq=False)
class Linearity:
    """Signal by exposure time, and how far it is from a line.

    error: mean absolute deviation, relative (EMVA's LE, as a share).
    drift: of the lamp from first to last exposure, relative; None where the order of exposures
        can't tell it.
    rate: signal by time, DN/s.
    exposure, signal, deviation: seconds, DN and relative deviation of each point of the fit, drift
        taken off.
    """

    error: Measured
    drift: Measured | None
    rate: float
    exposure: Array
    signal: Array
    deviation: Array


def measure_linearity(
    groups: Sequence[GroupStatistics], full: float | None, times: dict[float, float]
) -> Linearity | None:
    """Measure the linearity error; None with fewer than four exposures in between.

    full: signal at which pixels clip, DN; the largest signal where none does.
    times: when each exposure was taken, seconds, by exposure time; empty if unknown.

    Light that drifts with time is fitted beside the line, if exposures weren't taken in the order
    of their length.
    """
    exposure, signal, sigma, colour = _points(groups, full)
    if len(set(exposure)) < _LINEARITY_FEWEST:
        return None
    clock = _clock(exposure, times)
    drift = 0.0
    # Signals that drift is taken off from follow the line better, and tell what is left of it.
    for _ in range(1 if clock is None else _PASSES):
        steady = signal if clock is None else signal / (1 + drift * clock)
        matrix = _design(exposure, steady, colour, clock)
        inverse = np.linalg.pinv(matrix.T @ matrix)
        found = inverse @ matrix.T @ np.ones(len(steady))
        drift += 0.0 if clock is None else float(found[-1])
    deviation = 1 - matrix @ found
    freedom = max(len(signal) - matrix.shape[1], 1)
    chance_of_drift = math.sqrt(float((deviation**2).sum()) / freedom * inverse[-1, -1])
    size = np.abs(deviation)
    # Chance alone makes a mean deviation, too.
    chance = float((sigma / signal).mean())
    error = Measured(
        float(size.mean()), math.hypot(float(size.std()) / math.sqrt(len(size)), chance)
    )
    rate = float(np.mean(found[1 : 2 * len(set(colour)) : 2]))
    seen_drift = None if clock is None else Measured(drift, chance_of_drift)
    return Linearity(error, seen_drift, rate, exposure, steady, deviation)


def _clock(exposure: Array, times: dict[float, float]) -> Array | None:
    """Return when each point was taken, over the whole time, from -.5 to .5.

    None where that is unknown, or where exposures were taken in the order of their length.
    """
    span = float(np.ptp(list(times.values()))) if times else 0.0
    if not span:
        return None
    clock = np.array([times[one] for one in exposure])
    if abs(float(np.corrcoef(exposure, clock)[0, 1])) > _ALIKE:
        return None
    return np.asarray((clock - (max(times.values()) + min(times.values())) / 2) / span)


def _design(
    exposure: Array, signal: Array, colour: Sequence[tuple[int, int]], clock: Array | None
) -> Array:
    """Return the matrix of lines, one for each colour, and of drift, over the signals.

    Relative deviations are made the smallest (EMVA 1288, section 6.7).
    """
    columns = []
    for name in sorted(set(colour)):
        own = np.array([float(one == name) for one in colour])
        columns += [own, own * exposure]
    if clock is not None:
        columns.append(signal * clock)
    return np.asarray(np.stack(columns, axis=1) / signal[:, None])


def _points(
    groups: Sequence[GroupStatistics], full: float | None
) -> tuple[Array, Array, Array, list[tuple[int, int]]]:
    """Return exposure, signal, its noise and the filter's colour of the mean signals."""
    rows: list[tuple[float, float, float]] = []
    colours = []
    for colour in sorted({group.filter for group in groups}):
        same = [group.light for group in groups if group.filter == colour]
        top = full or max(one.signal for light in same for one in light)
        for light in zip(*same, strict=True):
            weights = np.array([one.count for one in light], dtype=np.float64)
            signal = float(np.average([one.signal for one in light], weights=weights))
            if all(_is_open(one, top, _HIGH) for one in light) and signal > _LOW * top:
                variance = float(np.average([one.variance for one in light], weights=weights))
                noise = math.sqrt(variance / (2 * weights.sum()))
                rows.append((light[0].exposure, signal, noise))
                colours.append(colour)
    exposure, signals, noises = np.array(rows).reshape(-1, 3).T
    return exposure, signals, noises, colours
