"""Generate a sensor's fixed pattern: what differs from pixel to pixel and stays the same."""

from __future__ import annotations

import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import torch

from optics.sensor.sensor import Sensor

_OFFSET_STEPS = 4
"""Steps of a pixel's offset per standard deviation. With whole steps, moments can be tabulated
exactly."""

_MAX_DEVIATIONS = 4.5
"""Standard deviations at which the random pattern is cut off. One pixel in 150,000 would lie
beyond."""

MAX_OFFSET_STEP = round(_MAX_DEVIATIONS * _OFFSET_STEPS)
"""Largest number of offset steps of a pixel."""


@dataclass(frozen=True, eq=False)
class FixedPattern:
    """Maps of what differs from pixel to pixel of one sensor.

    Parameters
    ----------
    response : torch.Tensor, (rows, columns), float32
        Factor on a pixel's response to light: 1 + PRNU, and 0 for a dead pixel.
    offset_steps : torch.Tensor, (rows, columns), int8
        DSNU: the offset that a pixel reads too much, in steps of `electrons_per_step`.
    electrons_per_step : float
        Electrons in one step of the offset.
    hot_current : torch.Tensor, (rows, columns), float32
        Electrons per second that hot pixels have beyond the dark current.
    """

    response: torch.Tensor
    offset_steps: torch.Tensor
    electrons_per_step: float
    hot_current: torch.Tensor

    @property
    def offset(self) -> torch.Tensor:
        """The offset that each sensor pixel adds to its reading, in electrons, float32."""
        return self.offset_steps.to(torch.float32) * self.electrons_per_step


def has_fixed_pattern(sensor: Sensor) -> bool:
    """Tell whether a sensor's pixels differ at all.

    Parameters
    ----------
    sensor : Sensor
        The sensor.

    Returns
    -------
    bool
        True if PRNU, DSNU, or the share of dead or of hot pixels isn't zero.
    """
    return sensor.prnu > 0 or sensor.dsnu > 0 or sensor.dead > 0 or sensor.hot > 0


_cached_patterns: WeakKeyDictionary[Sensor, FixedPattern] = WeakKeyDictionary()
"""Patterns by sensor. Equal sensors share one entry, which lasts as long as the first of them."""


def fixed_pattern(sensor: Sensor) -> FixedPattern:
    """Generate the maps of a sensor's fixed pattern, which are the same in every frame and run.

    They are random samples from the sensor's own seed. PRNU and DSNU are normal. DSNU comes in
    steps of a quarter of its standard deviation; the distribution is made narrower by as much as
    rounding widens it (Sheppard). Which pixels are dead or hot is by chance, with the shares that
    the sensor gives.

    Parameters
    ----------
    sensor : Sensor
        The sensor, whose `fixed_seed` determines the maps.

    Returns
    -------
    FixedPattern
        The maps, (rows, columns) each. Equal sensors share them.

    References
    ----------
    EMVA 1288 release 4, section 4.
    """
    found = _cached_patterns.get(sensor)
    if found is None:
        found = _cached_patterns[sensor] = _generate_pattern(sensor)
    return found


def _generate_pattern(sensor: Sensor) -> FixedPattern:
    generator = torch.Generator().manual_seed(sensor.fixed_seed)
    shape = sensor.shape
    gain = 1 + sensor.prnu * _normal(shape, generator)
    width = math.sqrt(_OFFSET_STEPS**2 - 1 / 12)
    steps = torch.round(width * _normal(shape, generator)).to(torch.int8)
    chance = torch.rand(shape, generator=generator, dtype=torch.float64)
    # One random number per pixel decides both, so that no pixel is dead and hot.
    gain[chance < sensor.dead] = 0.0
    hot = chance > 1 - sensor.hot if sensor.hot else torch.zeros(shape, dtype=torch.bool)
    return FixedPattern(
        gain.clamp(min=0.0), steps, sensor.dsnu / _OFFSET_STEPS, hot * float(sensor.hot_current)
    )


def _normal(shape: tuple[int, int], generator: torch.Generator) -> torch.Tensor:
    return torch.randn(shape, generator=generator).clamp(-_MAX_DEVIATIONS, _MAX_DEVIATIONS)
