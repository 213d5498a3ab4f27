"""What happens in pixels on the way to a number: stages, fixed pattern, and expected electrons."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray

from optics.sensor.sensor import Sensor
from optics.validation import require_choice, require_finite, require_positive

_OFFSET_STEPS = 4  # per standard deviation; with whole steps, moments can be tabulated exactly
_MAX_DEVIATIONS = 4.5  # at which the random pattern is cut off: one pixel in 150,000 lies beyond
MAX_OFFSET_STEP = round(_MAX_DEVIATIONS * _OFFSET_STEPS)  # largest number of a pixel


@dataclass(frozen=True, eq=False)
class FixedPattern:
    """Maps of what differs from pixel to pixel.

    Parameters
    ----------
    response : torch.Tensor, (rows, columns), float32
        Factor on a pixel's response to light: 1 + PRNU, and 0 for a dead pixel.
    offset_steps, electrons_per_step : torch.Tensor, (rows, columns), int8, and float
        DSNU: the offset that a pixel reads too much, in steps of so many electrons.
    hot_current : torch.Tensor, (rows, columns), float32
        Electrons per second that hot pixels have beyond the dark current.
    """

    response: torch.Tensor
    offset_steps: torch.Tensor
    electrons_per_step: float
    hot_current: torch.Tensor

    @property
    def offset(self) -> torch.Tensor:
        """Offset that each pixel adds to its reading, in electrons, float32."""
        return self.offset_steps.to(torch.float32) * self.electrons_per_step


def has_fixed_pattern(sensor: Sensor) -> bool:
    """Tell whether the pixels differ at all.

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


# Equal sensors share one entry, which lasts as long as the first of them.
_cached_patterns: WeakKeyDictionary[Sensor, FixedPattern] = WeakKeyDictionary()


def fixed_pattern(sensor: Sensor) -> FixedPattern:
    """Generate the maps of what differs from pixel to pixel, the same in every frame and run.

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
    if found is not None:
        return found
    generator = torch.Generator().manual_seed(sensor.fixed_seed)
    shape = sensor.shape
    first, second = (
        torch.randn(shape, generator=generator).clamp(-_MAX_DEVIATIONS, _MAX_DEVIATIONS)
        for _ in range(2)
    )
    chance = torch.rand(shape, generator=generator, dtype=torch.float64)
    # One random number per pixel decides both, so that no pixel is dead and hot.
    response = (1 + sensor.prnu * first).masked_fill_(chance < sensor.dead, 0.0).clamp(min=0.0)
    hot = chance > 1 - sensor.hot if sensor.hot else torch.zeros(shape, dtype=torch.bool)
    steps = torch.round(math.sqrt(_OFFSET_STEPS**2 - 1 / 12) * second).to(torch.int8)
    found = FixedPattern(
        response, steps, sensor.dsnu / _OFFSET_STEPS, hot * float(sensor.hot_current)
    )
    _cached_patterns[sensor] = found
    return found


ShotNoise = Literal["none", "Gaussian", "skewed", "Poisson"]

# Expected electrons below which shot noise is always sampled from Poisson's distribution. It costs
# as little there, and a normal distribution would be cut off at 0.
FEW_ELECTRONS = 10.0


@dataclass(frozen=True)
class Stages:
    """Selects which stages between light and digital numbers are simulated; all by default.

    They follow the order of the physics: dark current, fixed pattern (response and hot pixels;
    offsets come after the full well), shot noise, full well, read noise, converter.

    Parameters
    ----------
    dark_current, fixed_pattern : bool, default True
        Electrons without light; PRNU, DSNU, dead and hot pixels.
    shot : {"none", "Gaussian", "skewed", "Poisson"}, default "Poisson"
        Distribution of the electrons. "Gaussian" samples whole electrons from a normal distribution
        whose variance is the mean. "skewed" bends that as Poisson's distribution is: see
        `optics.sensor.frame_sampling.electrons_from_normal`. Both sample few electrons, below 10,
        from Poisson's distribution itself.
    clipping, read_noise, quantisation : bool, default True
        Saturation of the full well and of the converter; normal noise of the readout; rounding to
        whole digital numbers.

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
        require_choice("shot", self.shot, get_args(ShotNoise))


@dataclass(frozen=True, eq=False)
class CollectedCharge:
    """Expected electrons of each pixel, and the pixel's offset.

    electrons: float64, 0 or more. offset_steps: the offset in steps of `electrons_per_step`
    electrons, int8; None for a sensor without offsets.
    """

    electrons: torch.Tensor
    offset_steps: torch.Tensor | None = None
    electrons_per_step: float = 0.0

    def select(self, pixels: torch.Tensor) -> CollectedCharge:
        """Return the charge of the pixels that a mask selects."""
        steps = None if self.offset_steps is None else self.offset_steps[pixels]
        return CollectedCharge(self.electrons[pixels], steps, self.electrons_per_step)

    @property
    def offset(self) -> torch.Tensor | float:
        """Offsets of the pixels in electrons, float64; 0 where there are none."""
        if self.offset_steps is None:
            return 0.0
        return self.offset_steps.to(torch.float64) * self.electrons_per_step


def collect_electrons(
    electrons: torch.Tensor, exposure: float, sensor: Sensor, stages: Stages
) -> CollectedCharge:
    """Compute the expected photoelectrons of each pixel at the end of an exposure.

    The electrons from light may have any shape; if pixels differ, that of the whole sensor.
    Negative ones count as zero. Raises ValueError for numbers that aren't finite, and for a picture
    of another shape.
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


def mix_neighbours(electrons: torch.Tensor, share: float) -> torch.Tensor:
    """Return the electrons that pixels collect when each loses some to its neighbours: crosstalk.

    Along rows and along columns, the two neighbours of a pixel get `share` of its electrons each,
    0 to 1/4. Pixels beyond the sensor's edge are taken to be as bright as those at the edge, so
    that no light is lost there. Djité et al. 2012, Theoretical models of modulation transfer
    function, quantum efficiency, and crosstalk for CCD and CMOS image sensors.
    """
    for axis in (-2, -1):
        count = electrons.shape[axis]
        before = torch.arange(-1, count - 1).clamp(min=0)
        after = torch.arange(1, count + 1).clamp(max=count - 1)
        beside = electrons.index_select(axis, before) + electrons.index_select(axis, after)
        electrons = (1 - 2 * share) * electrons + share * beside
    return electrons


def max_contrast_loss(
    share: float, frequency: NDArray[np.float64], pitch: float
) -> NDArray[np.float64]:
    """Bound what crosstalk takes of the MTF, at cycles per metre in any direction.

    The MTF is the product of 1 - 2 share (1 - cos 2π f pitch) along both axes.
    """
    return np.minimum(share * (2 * np.pi * frequency * pitch) ** 2, 1 - (1 - 4 * share) ** 2)
