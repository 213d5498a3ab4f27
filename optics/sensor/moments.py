"""Mean and variance of every pixel's number, exactly, without drawing any."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.sensor.chain import FEW, Collected, Stages, collected
from optics.sensor.reading import read_out
from optics.sensor.sensor import Sensor
from optics.sensor.table import pieces

_AT_ONCE = 1 << 17
"""Pixels that are worked out together: they stay in a processor's own memory."""


def moments(
    electrons: torch.Tensor,
    exposure: float,
    sensor: Sensor,
    **switches: Any,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean, in electrons, and variance, in electrons², of what draw() gives with the same.

    electrons: expected from light on each pixel over the exposure. switches: as draw() takes
    them. Both answers are float64 of
    its shape, of (number - black level) gain. They are sums over all numbers of electrons and
    all digital numbers, tabulated and interpolated: to 1e-4 of themselves. Raises ValueError
    for electrons that aren't finite, and an exposure that isn't positive.
    """
    stages = Stages(**switches)
    if stages.shot == "skewed":
        # What is skewed as Poisson's distribution is, is counted as that.
        stages = replace(stages, shot="Poisson")
    held = collected(electrons, exposure, sensor, stages)
    if stages.shot == "none":
        return _still(held, sensor, stages)
    if stages.shot == "Poisson" and not stages.clipping and not stages.quantisation:
        noise = sensor.read_noise**2 if stages.read_noise else 0.0
        return held.electrons + held.offset, held.electrons + noise
    few = held.electrons < FEW
    if stages.shot == "Poisson" or bool(few.all()):
        return _tabulated(held, sensor, replace(stages, shot="Poisson"))
    normal = _tabulated(held, sensor, stages)
    if not bool(few.any()):
        return normal
    poisson = _tabulated(held.only(few), sensor, replace(stages, shot="Poisson"))
    for whole, part in zip(normal, poisson, strict=True):
        whole[few] = part
    return normal


def _still(held: Collected, sensor: Sensor, stages: Stages) -> tuple[torch.Tensor, torch.Tensor]:
    """Where electrons don't come by chance, each pixel by itself."""
    full = held.electrons
    if stages.clipping:
        full = full.clamp(max=sensor.full_well)
    flat = (full + held.offset).flatten()
    starts = range(0, flat.numel(), _AT_ONCE)
    parts = [read_out(flat[n : n + _AT_ONCE].numpy(), sensor, stages) for n in starts]
    mean, variance = (torch.from_numpy(np.concatenate(one)) for one in zip(*parts, strict=True))
    return mean.reshape(full.shape), variance.reshape(full.shape)


def _tabulated(
    held: Collected, sensor: Sensor, stages: Stages
) -> tuple[torch.Tensor, torch.Tensor]:
    electrons = held.electrons
    most = float(electrons.max()) if electrons.numel() else 0.0
    dark, *bright = pieces(sensor, stages, most, held.step)
    mean, variance = dark(electrons, held.steps)
    if dark.final or most <= dark.high:
        return mean, variance
    # So much light that nothing but shot noise is left of the noises, before wells are full.
    noise = sensor.read_noise**2 if stages.read_noise else 0.0
    step = sensor.gain**2 / 12 if stages.quantisation else 0.0
    much = electrons > dark.high
    mean = torch.where(much, electrons + held.offset, mean)
    variance = torch.where(much, electrons + noise + step, variance)
    for table in bright:
        full = electrons >= table.low
        if bool(full.any()):
            some = held.only(full)
            mean[full], variance[full] = table(some.electrons, some.steps)
    return mean, variance
