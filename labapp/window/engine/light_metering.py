"""Exposures that are found by trial frames: one for a level, or a bracket."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.brackets.choice import bare_seconds, equal_ladders, least_snr_db
from labapp.window.exposure_bracket import DARK_FRAMES
from optics.camera import Sensor
from optics.hdr import ChosenBracket, ExposureLimits, Meter, MeteredRange, WantedSNR, choose_bracket
from optics.hdr.exposures import AllowedTimes, ExposureSNR
from optics.measuring import exposure_for_level, peak_level

TakeTrial = Callable[[float], tuple[float, NDArray[Any]]]
"""Takes a trial frame of about this exposure in seconds, and returns the real one and the frame."""

_PATTERNS = 2
"""Patterns of a bracket, which share the dark frames: neutral, and the chosen one."""


@dataclass(frozen=True)
class LevelSettings:
    """Tune the search for an exposure; all values are chosen.

    snr_db, decades: what is asked of the meter: the brightest pixels' light to some percent, and no
        more.
    longest: longest exposure, s. A longer one is for a person to ask for.
    closeness: relative difference from the wanted level that is near enough.
    corrections: most trial frames after the first at the exposure that was found.
    least_snr: signal over noise of the brightest pixel below which it isn't taken for light, where
        the longest exposure shows no more. The noise alone reaches 5 in some pixel of ten million.
    dimmer: factor to the next exposure if pixels are saturated against expectation.
    """

    snr_db: float = 30.0
    decades: float = 1.0
    longest: float = 10.0
    closeness: float = 0.05
    corrections: int = 3
    least_snr: float = 8.0
    dimmer: float = 0.7


SETTINGS = LevelSettings()


@dataclass(frozen=True)
class FoundExposure:
    """An exposure that brings the picture to a level.

    exposure: s.
    level: the level that it reaches.
    frames: trial frames.
    limit: "shortest" or "longest" if that end of the range was reached first.
    """

    exposure: float
    level: float
    frames: int
    limit: str = ""


def find_exposure(
    take: TakeTrial,
    sensor: Sensor,
    limits: ExposureLimits,
    level: float,
    first: float,
    is_clip_told: bool = True,
) -> FoundExposure:
    """Find the exposure that brings the brightest pixel to a level.

    Frames are metered until the brightest pixel's light is known; the exposure that follows is
    tried, and corrected. Raises ValueError if pixels are saturated in the shortest exposure,
    nothing is seen in the longest, or the level is none.

    sensor: tells gain, noise and full scale.
    level: share of the range from the black level to full scale, above 0 and below 1.
    first: exposure to begin with, s.
    is_clip_told: whether it is known that pixels clip at the sensor's full scale.
    """
    allowed = AllowedTimes(limits)
    metered = _meter(take, sensor, limits, first, SETTINGS.snr_db, SETTINGS.decades, is_clip_told)
    sensor = metered.sensor_as_seen(sensor)
    wanted, frames = exposure_for_level(level, metered.high, sensor), len(metered.times)
    for _ in range(1 + SETTINGS.corrections):
        nearest = allowed.time(max(allowed.last_up_to(wanted), 0))
        exposure, numbers = take(nearest)
        seen = peak_level(numbers, sensor)
        frames += 1
        limit = _limit(wanted, limits)
        if limit or abs(seen.level / level - 1) <= SETTINGS.closeness:
            break
        wanted = exposure * (SETTINGS.dimmer if seen.level >= 1 else level / seen.level)
    if limit == "longest":
        _require_seen(seen.level, exposure, sensor)
    return FoundExposure(exposure, seen.level, frames, limit)


def _require_seen(level: float, exposure: float, sensor: Sensor) -> None:
    """Raise ValueError if the brightest pixel may be noise."""
    charge = level * (sensor.full_scale - sensor.black_level) * sensor.gain
    light = max(charge - sensor.dark_current * exposure, 0.0)
    if light < SETTINGS.least_snr * math.sqrt(light + ExposureSNR(sensor).floor(exposure)):
        raise ValueError(
            f"nothing is seen in the longest trial frame, of {exposure * 1e3:g} ms. Brighten the "
            "light, or bring it into the picture"
        )


def _limit(wanted: float, limits: ExposureLimits) -> str:
    """Return which end of the allowed exposures one lies beyond; empty for none."""
    if wanted > limits.longest * (1 + SETTINGS.closeness):
        return "longest"
    return "shortest" if wanted < limits.shortest * (1 - SETTINGS.closeness) else ""


@dataclass(frozen=True)
class ProposedExposures:
    """A proposed bracket, with the range of light that was metered.

    ladders: seconds of the ladders that reach the same, by name.
    """

    metered: MeteredRange
    bracket: ChosenBracket
    least_snr_db: float
    seconds: float
    ladders: dict[str, float]


def propose_exposures(
    take: TakeTrial,
    sensor: Sensor,
    limits: ExposureLimits,
    snr_db: float,
    decades: float,
    first: float,
    is_clip_told: bool = True,
) -> ProposedExposures:
    """Propose a bracket for the light in the picture.

    Raises ValueError if the light is too bright or too dim, or no bracket reaches the ratio.
    """
    metered = _meter(take, sensor, limits, first, snr_db, decades, is_clip_told)
    sensor = metered.sensor_as_seen(sensor)
    darks = float(DARK_FRAMES)
    wanted = WantedSNR(snr_db, metered.low, metered.high, darks, darks / _PATTERNS)
    bracket = choose_bracket(sensor, wanted, limits)
    ladders = equal_ladders(sensor, wanted, limits)
    return ProposedExposures(
        metered,
        bracket,
        least_snr_db(bracket, wanted),
        bare_seconds(bracket, limits),
        {name: bare_seconds(one, limits) for name, one in ladders.items()},
    )


def _meter(
    take: TakeTrial,
    sensor: Sensor,
    limits: ExposureLimits,
    first: float,
    snr_db: float,
    decades: float,
    is_clip_told: bool,
) -> MeteredRange:
    """Meter the light in the picture by trial frames."""
    meter = Meter(sensor, limits, first, snr_db, decades, is_clip_told)
    while meter.next_time is not None:
        exposure, numbers = take(meter.next_time)
        meter.add(exposure, np.asarray(numbers))
    return meter.metered_range
