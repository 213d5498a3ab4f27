"""The sensor's stages, in the order of the physics, and which of them are done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.sensor.fixed_pattern import fixed_pattern, has_fixed_pattern
from optics.sensor.sensor import Sensor
from optics.validation import require_finite, require_positive

ShotNoise = Literal["none", "Gaussian", "skewed", "Poisson"]

FEW_ELECTRONS = 10.0
"""Electrons below which Poisson's distribution is drawn from in any case: it costs as little
there, and a normal one would be cut at 0."""


@dataclass(frozen=True)
class Stages:
    """Which stages of a sensor are simulated; all of them by default.

    They follow the order of the physics: dark current, fixed pattern (response and hot pixels;
    offsets come after the full well), shot noise, full well, read noise, converter.

    Parameters
    ----------
    dark_current : bool, default True
        Electrons without light.
    fixed_pattern : bool, default True
        PRNU, DSNU, dead and hot pixels.
    shot : {"none", "Gaussian", "skewed", "Poisson"}, default "Poisson"
        Distribution of the electrons. "Gaussian" samples whole electrons from a normal distribution
        whose variance is the mean. "skewed" bends that as Poisson's distribution is: see
        `optics.sensor.frame_sampling.electrons_from_normal`. Both sample few electrons, below 10,
        from Poisson's distribution itself.
    clipping : bool, default True
        Saturation of the full well and of the converter.
    read_noise : bool, default True
        Normal noise of the readout.
    quantisation : bool, default True
        Rounding to whole digital numbers.

    Raises
    ------
    ValueError
        If `shot` is another word.
    """

    dark_current: bool = True
    fixed_pattern: bool = True
    shot: ShotNoise = "Poisson"
    clipping: bool = True
    read_noise: bool = True
    quantisation: bool = True

    def __post_init__(self) -> None:
        if self.shot not in ("none", "Gaussian", "skewed", "Poisson"):
            raise ValueError(f"shot is {self.shot!r}; choose none, Gaussian, skewed or Poisson")


@dataclass(frozen=True, eq=False)
class CollectedCharge:
    """What is there to be read: expected electrons of each pixel, and what it reads too much.

    electrons: float64, 0 or more. offset_steps: int8 numbers of `electrons_per_step` electrons;
    None where no pixel reads too much.
    """

    electrons: torch.Tensor
    offset_steps: torch.Tensor | None = None
    electrons_per_step: float = 0.0

    def select(self, pixels: torch.Tensor) -> CollectedCharge:
        """Some of the pixels, by a mask."""
        steps = None if self.offset_steps is None else self.offset_steps[pixels]
        return CollectedCharge(self.electrons[pixels], steps, self.electrons_per_step)

    @property
    def offset(self) -> torch.Tensor | float:
        """Electrons, float64; 0 where no pixel reads too much."""
        return (
            0.0
            if self.offset_steps is None
            else self.offset_steps.to(torch.float64) * self.electrons_per_step
        )


def collect_electrons(
    electrons: torch.Tensor, exposure: float, sensor: Sensor, stages: Stages
) -> CollectedCharge:
    """The electrons that each pixel holds in the mean at the end of an exposure.

    electrons: of light, over the exposure, any shape; (rows, columns) of the sensor where its
    pixels differ. Negative ones count as none. Raises ValueError for numbers that aren't
    finite, and for a picture of another shape.
    """
    require_positive("exposure", exposure, "s")
    require_finite("electrons", electrons)
    mean = electrons.to(torch.float64).clamp(min=0)
    dark = sensor.dark_current * exposure if stages.dark_current else 0.0
    if not (stages.fixed_pattern and has_fixed_pattern(sensor)):
        return CollectedCharge(mean + dark if dark else mean)
    if tuple(electrons.shape) != sensor.shape:
        raise ValueError(
            f"electrons is {tuple(electrons.shape)}; the sensor's pixels differ, so it must be "
            f"the whole sensor's, {sensor.shape}"
        )
    pattern = fixed_pattern(sensor)
    mean = mean * pattern.response + dark
    if sensor.hot and sensor.hot_current and stages.dark_current:
        mean = mean + pattern.hot_current * exposure
    steps = pattern.offset_steps if sensor.dsnu else None
    return CollectedCharge(mean, steps, pattern.electrons_per_step)
