"""Define the stages of a sensor's simulation, and compute the expected electrons of its pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.sensor.fixed_pattern import fixed_pattern, has_fixed_pattern
from optics.sensor.sensor import Sensor
from optics.validation import require_finite, require_positive

ShotNoise = Literal["none", "Gaussian", "skewed", "Poisson"]

FEW_ELECTRONS = 10.0
"""Expected electrons below which shot noise is always sampled from Poisson's distribution. It costs
as little there, and a normal distribution would be cut off at 0."""


@dataclass(frozen=True)
class Stages:
    """Selects which stages of a sensor are simulated; all of them by default.

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
    """Holds the expected electrons of each pixel of a sensor, and the pixel's offset.

    electrons: float64, 0 or more. offset_steps: the offset in steps of `electrons_per_step`
    electrons, int8; None for a sensor without offsets.
    """

    electrons: torch.Tensor
    offset_steps: torch.Tensor | None = None
    electrons_per_step: float = 0.0

    def select(self, pixels: torch.Tensor) -> CollectedCharge:
        """Return the photoelectrons of the sensor pixels that a mask selects."""
        steps = None if self.offset_steps is None else self.offset_steps[pixels]
        return CollectedCharge(self.electrons[pixels], steps, self.electrons_per_step)

    @property
    def offset(self) -> torch.Tensor | float:
        """The sensor pixels' offsets in electrons, float64; 0 for a sensor without offsets."""
        return (
            0.0
            if self.offset_steps is None
            else self.offset_steps.to(torch.float64) * self.electrons_per_step
        )


def collect_electrons(
    electrons: torch.Tensor, exposure: float, sensor: Sensor, stages: Stages
) -> CollectedCharge:
    """Compute the expected photoelectrons of each sensor pixel at the end of an exposure.

    electrons: from light, over the exposure, of any shape; (rows, columns) of the whole sensor if
    its pixels differ. Negative ones count as zero. Raises ValueError for numbers that aren't
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
