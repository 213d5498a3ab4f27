"""Sample frames at random: digital numbers from expected electrons."""

from __future__ import annotations

from typing import Any, Literal

import torch

from optics.sensor.sensor import Sensor
from optics.sensor.stages import FEW_ELECTRONS, Stages, collect_electrons
from optics.validation import require_finite, require_positive

# Light, in full wells, at which expected electrons are cut off. More light makes no difference, and
# would overflow the generator of Poisson's distribution.
_MAX_FULL_WELLS = 4.0

_ROUNDING_VARIANCE = 1 / 12  # that rounding to whole electrons adds to a normal draw (Sheppard)


def expose(
    rate: torch.Tensor,
    exposure: float,
    sensor: Sensor,
    generator: torch.Generator,
    *,
    shot_noise: bool = True,
    read_noise: bool = True,
    dark_current: bool = True,
) -> torch.Tensor:
    """Sample one raw frame of pixels that are all alike, from photoelectrons to the ADC's numbers.

    The stages follow the order of the physics: dark current, shot noise, full well, read noise,
    gain and black level, quantisation and clipping.

    Parameters
    ----------
    rate, exposure : torch.Tensor, (rows, columns), float
        Photo-electrons per second and pixel, dark if negative; exposure time in seconds.
    sensor, generator : Sensor, torch.Generator
        The sensor, and the source of all random numbers.
    shot_noise, read_noise, dark_current : bool, default True
        Whether that stage is simulated.

    Returns
    -------
    torch.Tensor, (rows, columns), int32
        Digital numbers, 0 to 2**bits - 1.

    Raises
    ------
    ValueError
        If the exposure isn't positive, or a rate isn't finite.
    """
    require_positive("exposure", exposure, "s")
    require_finite("rate", rate)
    mean = rate.clamp(min=0) * exposure
    if dark_current:
        mean = mean + sensor.dark_current * exposure
    mean = mean.clamp(max=_MAX_FULL_WELLS * sensor.full_well + 1000)
    electrons = torch.poisson(mean, generator=generator) if shot_noise else mean
    electrons = electrons.clamp(max=sensor.full_well)
    if read_noise:
        noise = torch.randn(mean.shape, generator=generator, dtype=mean.dtype, device=mean.device)
        electrons = electrons + sensor.read_noise * noise
    number = torch.round(electrons / sensor.gain + sensor.black_level)
    return number.clamp(0, sensor.top_number).to(torch.int32)


def sample_frame(
    electrons: torch.Tensor,
    exposure: float,
    sensor: Sensor,
    generator: torch.Generator,
    **switches: Any,
) -> torch.Tensor:
    """Sample one raw frame, from photoelectrons to the ADC's numbers.

    Parameters
    ----------
    electrons, exposure : torch.Tensor, (rows, columns), float
        Electrons expected from light on each pixel over the exposure, none if negative; exposure
        time in seconds.
    sensor, generator : Sensor, torch.Generator
        The sensor, which `electrons` must cover if its pixels differ; source of all random numbers.
    **switches : bool or str
        Which stages are simulated: the fields of `Stages`.

    Returns
    -------
    torch.Tensor, (rows, columns), int32
        Digital numbers; float64 without quantisation.

    Raises
    ------
    ValueError
        If electrons aren't finite or have another shape than a sensor whose pixels differ, or if
        the exposure isn't positive.
    """
    stages = Stages(**switches)
    held = collect_electrons(electrons, exposure, sensor, stages)
    mean = held.electrons
    if stages.clipping:
        mean = mean.clamp(max=_MAX_FULL_WELLS * sensor.full_well + 1000)
    counted = _sample_electrons(mean, stages, generator)
    if stages.clipping:
        counted = counted.clamp(max=sensor.full_well)
    counted = counted + held.offset
    if stages.read_noise and sensor.read_noise:
        counted = counted + sensor.read_noise * _normal(mean, generator)
    number = counted / sensor.gain + sensor.black_level
    if stages.quantisation:
        number = torch.round(number)
    if stages.clipping:
        number = number.clamp(0, sensor.top_number)
    return number.to(torch.int32) if stages.quantisation else number


def electrons_from_normal(
    mean: torch.Tensor, noise: torch.Tensor, shot: Literal["Gaussian", "skewed"]
) -> torch.Tensor:
    """Convert standard normal numbers to shot noise: whole electrons around a mean.

    The mean is FEW_ELECTRONS or more. With "Gaussian", mean and variance are Poisson's, and the
    distribution differs by 0.07/√mean (Kolmogorov). With "skewed", the third and fourth moments are
    corrected too, which leaves a difference of 3e-4 at ten electrons and 2e-5 at sixty (Cornish and
    Fisher 1937, Rev. Inst. Int. Stat. 5, 307). Both are made narrower by as much as rounding widens
    them (Sheppard 1898).
    """
    counted = torch.addcmul(mean, mean / (mean + _ROUNDING_VARIANCE).sqrt(), noise)
    if shot == "skewed":
        square = noise.square()
        counted += (square - 1) / 6
        counted += noise * (1 - square) / (72 * mean.sqrt())
    return counted.round_().clamp_(min=0)


def _sample_electrons(
    mean: torch.Tensor, stages: Stages, generator: torch.Generator
) -> torch.Tensor:
    """Sample each pixel's photoelectrons, with the shot noise of `stages`."""
    if stages.shot == "none":
        return mean
    # From 1e8 electrons on, Poisson's distribution is within 1e-5 of the normal one everywhere.
    few = mean < (1e8 if stages.shot == "Poisson" else FEW_ELECTRONS)
    if bool(few.all()):
        return torch.poisson(mean, generator=generator)
    counted = electrons_from_normal(
        mean, _normal(mean, generator), "skewed" if stages.shot == "skewed" else "Gaussian"
    )
    if bool(few.any()):
        counted[few] = torch.poisson(mean[few], generator=generator)
    return counted


def _normal(like: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    return torch.randn(like.shape, generator=generator, dtype=like.dtype)
