"""The shadows of dust on the sensor's cover glass: core and penumbra, by the cone of light."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Lens, Sensor

Array = NDArray[np.float64]

# Samples along a shadow's softest or hardest edge, and most of them along a pixel. Chosen.
_SAMPLES_PER_EDGE, _MOST_SAMPLES = 8, 16


@dataclass(frozen=True, eq=False)
class Shadow:
    """The share of the light that a speck takes from the pixels at (rows, columns)."""

    rows: slice
    columns: slice
    loss: Array


@functools.lru_cache(maxsize=8)
def dust_shadows(sensor: Sensor, lens: Lens) -> tuple[Shadow, ...]:
    """Return the shadows of a sensor's dust; specks whose shadow is beside it have none.

    The cone of light from the lens' stop to a pixel, taken to be round and even, meets the glass in
    a disc; the share of it that the speck covers is lost.
    """
    return tuple(one for speck in sensor.dust if (one := _shadow(sensor, lens, speck)) is not None)


def cast_shadows(light: torch.Tensor, sensor: Sensor, lens: Lens) -> None:
    """Take from the light on pixels, (channels, rows, columns), what dust holds back, in place."""
    for one in dust_shadows(sensor, lens):
        left = torch.from_numpy(1 - one.loss).to(light)
        light[:, one.rows, one.columns] *= left


def _shadow(sensor: Sensor, lens: Lens, speck: tuple[float, float, float]) -> Shadow | None:
    """Return a speck's shadow, or None if it is beside the sensor."""
    y, x, diameter = speck
    # From a pixel, the middle of the stop is seen towards the axis.
    oblique = 1 - sensor.dust_distance / lens.image_distance
    cone = lens.stop_diameter / 2 * sensor.dust_distance / lens.image_distance
    reach = (cone + diameter / 2) / oblique
    sides = [
        _pixels(at / oblique, reach, count, sensor.pitch)
        for at, count in zip((y, x), sensor.shape, strict=True)
    ]
    if any(side.stop <= side.start for side in sides):
        return None
    fine = math.ceil(_SAMPLES_PER_EDGE * sensor.pitch / min(2 * cone, diameter))
    fine = min(max(fine, 1), _MOST_SAMPLES)
    rows, columns = (
        oblique * _samples(side, count, sensor.pitch, fine) - at
        for side, count, at in zip(sides, sensor.shape, (y, x), strict=True)
    )
    away = np.hypot(rows[:, None], columns)
    covered = _common_area(cone, diameter / 2, away) / (math.pi * cone**2)
    pixels = covered.reshape(len(rows) // fine, fine, len(columns) // fine, fine).mean((1, 3))
    return Shadow(sides[0], sides[1], pixels)


def _pixels(middle: float, reach: float, count: int, pitch: float) -> slice:
    """Return the pixels along an axis that a shadow falls on."""
    first = math.floor((middle - reach) / pitch + 0.5) + count // 2
    last = math.ceil((middle + reach) / pitch - 0.5) + count // 2
    return slice(min(max(first, 0), count), min(max(last + 1, 0), count))


def _samples(side: slice, count: int, pitch: float, fine: int) -> Array:
    """Return where a shadow is sampled along an axis, metres, `fine` times in a pixel."""
    pixels = np.arange(side.start, side.stop) - count // 2
    within = (np.arange(fine) + 0.5) / fine - 0.5
    return np.asarray((pixels[:, None] + within).ravel() * pitch)


def _common_area(one: float, other: float, away: Array) -> Array:
    """Return the area that two discs have in common: that of two circular segments.

    one, other: their radii, metres. away: between their middles, metres.
    """
    small, large = min(one, other), max(one, other)
    d = np.clip(away, max(large - small, 1e-12 * large), large + small)

    def segment(radius: float, rest: float) -> Array:
        towards = np.clip((d**2 + radius**2 - rest**2) / (2 * d * radius), -1, 1)
        return np.asarray(radius**2 * (np.arccos(towards) - towards * np.sqrt(1 - towards**2)))

    area = segment(small, large) + segment(large, small)
    return np.where(away <= large - small, math.pi * small**2, area)
