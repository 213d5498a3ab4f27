"""Find where a camera saturates: the number at which pixels clip, and the largest variance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from optics.camera_noise.group_statistics import GroupStatistics, LightStatistics
from optics.camera_noise.measured import Measured, weighted_mean
from optics.camera_noise.rounded_noise import STEP_VARIANCE, SURE_VARIANCE

_FULL_VARIANCE = 0.1
"""Variance, relative to the largest, below which a group beyond it is saturated. Chosen: read noise
is left of the noise, and of an evenly lit group no pixel that isn't full."""

_AT_TOP = 0.5
"""Numbers from the converter's end within which a saturated mean is its end."""


@dataclass(frozen=True)
class ClipLevel:
    """The number at which a camera's pixels clip, DN, and what ends there."""

    number: Measured
    limit: Literal["converter", "well"]


def find_clip_level(groups: Sequence[GroupStatistics], top_number: int) -> ClipLevel | None:
    """Find the number at which a camera's pixels clip; None if no group of them saturates.

    Raises ValueError if numbers exceed the converter's end as it is said to be.
    """
    full = [one for group in groups for one in _saturated_exposures(group.light)]
    if any(one.brightest > top_number for group in groups for one in group.light):
        most = max(one.brightest for group in groups for one in group.light)
        raise ValueError(
            f"frames have numbers up to {most:g}, and the converter is said to end at "
            f"{top_number}; correct the sensor's bits or clip level"
        )
    if not full:
        return None
    means = np.array([one.mean for one in full])
    # A converter's end has no noise. Its numbers are whole.
    sigmas = np.array([math.sqrt(max(one.variance, 1e-6) / (2 * one.count)) for one in full])
    number = weighted_mean(means, sigmas)
    is_top = number.value > top_number - _AT_TOP
    if is_top or np.mean([one.variance for one in full]) < SURE_VARIANCE:
        # Rounding hides where between two steps the end is.
        number = Measured(number.value, math.hypot(number.sigma, math.sqrt(STEP_VARIANCE)))
    return ClipLevel(number, "converter" if is_top else "well")


def _saturated_exposures(light: Sequence[LightStatistics]) -> list[LightStatistics]:
    """Return the exposures of a group of a camera's pixels at which all are saturated."""
    largest = max(range(len(light)), key=lambda number: light[number].variance)
    limit = _FULL_VARIANCE * light[largest].variance
    return [one for one in light[largest + 1 :] if one.variance < limit + one.dark_variance]


def is_open(one: LightStatistics, full: float | None, share: float) -> bool:
    """Tell whether a group of a camera's pixels is below a share of saturation.

    full: signal at which pixels clip, DN; None if none does. Its brightest pixel must be clear of
    clipping, too, which counts where light is uneven.
    """
    if full is None:
        return True
    dark = one.mean - one.signal
    return one.signal <= share * full and one.brightest - dark <= (1 + share) / 2 * full


def saturation_signal(groups: Sequence[GroupStatistics]) -> Measured | None:
    """Return the signal at which a camera's variance is largest, DN (EMVA 1288, section 6.6).

    It is known to the spacing of the exposures. None if the variance still rises at the longest.
    The groups that are lit as the middle one is tell it.
    """
    found = []
    for group in groups:
        light = group.light
        largest = max(range(len(light)), key=lambda number: light[number].variance)
        if largest == len(light) - 1:
            continue
        below = light[max(largest - 1, 0)].signal
        step = max(light[largest].signal - below, light[largest + 1].signal - light[largest].signal)
        found.append((light[largest].signal, step / math.sqrt(12)))
    if not found:
        return None
    signals, steps = (np.array(one) for one in zip(*found, strict=True))
    return Measured(float(np.median(signals)), float(np.median(steps)))
