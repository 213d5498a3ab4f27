"""Compute mean and variance of every pixel of a sensor, without sampling frames."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.sensor.converter import readout_moments
from optics.sensor.moment_table import BATCH_PIXELS, moment_tables
from optics.sensor.sensor import Sensor
from optics.sensor.stages import FEW_ELECTRONS, CollectedCharge, Stages, collect_electrons


def moments(
    electrons: torch.Tensor,
    exposure: float,
    sensor: Sensor,
    **switches: Any,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute mean and variance of every sensor pixel's digital number, without sampling a frame.

    The moments describe the frames of `sample_frame`. They are sums over all numbers of electrons
    and all digital numbers, tabulated and interpolated, with a relative error of 1e-4. They refer
    to (number - black level) · gain.

    Parameters
    ----------
    electrons : torch.Tensor, (rows, columns)
        Electrons expected from light on each pixel over the exposure.
    exposure : float
        Exposure time in seconds.
    sensor : Sensor
        The sensor.
    **switches : bool or str
        Which stages are simulated: the fields of `Stages`. "skewed" shot noise counts as Poisson's.

    Returns
    -------
    mean : torch.Tensor, (rows, columns), float64
        Electrons.
    variance : torch.Tensor, (rows, columns), float64
        Electrons².

    Raises
    ------
    ValueError
        If electrons aren't finite, or the exposure isn't positive.
    """
    stages = Stages(**switches)
    if stages.shot == "skewed":
        # "skewed" shot noise approximates Poisson's distribution, so it has the same moments.
        stages = replace(stages, shot="Poisson")
    held = collect_electrons(electrons, exposure, sensor, stages)
    if stages.shot == "none":
        return _moments_without_shot_noise(held, sensor, stages)
    if stages.shot == "Poisson" and not stages.clipping and not stages.quantisation:
        noise = sensor.read_noise**2 if stages.read_noise else 0.0
        return held.electrons + held.offset, held.electrons + noise
    few = held.electrons < FEW_ELECTRONS
    if stages.shot == "Poisson" or bool(few.all()):
        return _tabulated_moments(held, sensor, replace(stages, shot="Poisson"))
    normal = _tabulated_moments(held, sensor, stages)
    if not bool(few.any()):
        return normal
    poisson = _tabulated_moments(held.select(few), sensor, replace(stages, shot="Poisson"))
    for whole, part in zip(normal, poisson, strict=True):
        whole[few] = part
    return normal


def _moments_without_shot_noise(
    charge: CollectedCharge, sensor: Sensor, stages: Stages
) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute each pixel's mean and variance separately, for a sensor without shot noise."""
    full = charge.electrons
    if stages.clipping:
        full = full.clamp(max=sensor.full_well)
    flat = (full + charge.offset).flatten()
    starts = range(0, flat.numel(), BATCH_PIXELS)
    parts = [readout_moments(flat[n : n + BATCH_PIXELS].numpy(), sensor, stages) for n in starts]
    mean, variance = (torch.from_numpy(np.concatenate(one)) for one in zip(*parts, strict=True))
    return mean.reshape(full.shape), variance.reshape(full.shape)


def _tabulated_moments(
    charge: CollectedCharge, sensor: Sensor, stages: Stages
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return each sensor pixel's mean and variance from tables over the expected photoelectrons."""
    electrons = charge.electrons
    most = float(electrons.max()) if electrons.numel() else 0.0
    dark, *bright = moment_tables(sensor, stages, most, charge.electrons_per_step)
    mean, variance = dark(electrons, charge.offset_steps)
    if dark.covers_saturation or most <= dark.high:
        return mean, variance
    # Between the tables, so much light falls on the pixels that rounding and read noise only add
    # their variances to the shot noise.
    noise = sensor.read_noise**2 if stages.read_noise else 0.0
    step = sensor.gain**2 / 12 if stages.quantisation else 0.0
    much = electrons > dark.high
    mean = torch.where(much, electrons + charge.offset, mean)
    variance = torch.where(much, electrons + noise + step, variance)
    for table in bright:
        full = electrons >= table.low
        if bool(full.any()):
            some = charge.select(full)
            mean[full], variance[full] = table(some.electrons, some.offset_steps)
    return mean, variance
