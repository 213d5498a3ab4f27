"""Means and variances by expected electrons, for all pixels of a sensor."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from optics.sensor.chain import Shot, Stages
from optics.sensor.counting import Numbers, likelihoods, window
from optics.sensor.reading import read_out
from optics.sensor.sensor import Sensor

_FINENESS = 16
"""Nodes of a table for a unit of sqrt(electrons), which is two standard deviations."""

_START = 3 / 8
"""Nodes are even in sqrt(electrons + this) (Anscombe 1948), where shot noise is even too."""

_COUNTED = 2.0**17
"""Electrons beyond which, unless they are clipped, rounding is far finer than shot noise."""

_FULL = 9.0
"""Standard deviations around a limit beyond which a pixel surely is, or isn't, full."""

_FINER = 16
"""Times by which a table is made finer by splines, so that lines serve between its nodes."""

_AT_ONCE = 1 << 17
"""Pixels that are worked out together: they stay in a processor's own memory."""


def pieces(sensor: Sensor, stages: Stages, most: float, step: float = 0.0) -> tuple[Table, ...]:
    """The tables that pixels of up to `most` electrons need, kept for the next.

    One from darkness on; where wells are deep, it ends where rounding is far finer than shot
    noise, and another one begins near the full well. Between them, mean and variance are those
    of plain shot noise. step: electrons of a step of offset; 0 where there is none.
    """
    stages = replace(stages, dark_current=True, fixed_pattern=True)
    low, high = _full(sensor, stages)
    if high <= _COUNTED:
        return (_table(sensor, stages, 0.0, _rounded_up(most, high), step),)
    dark = _table(sensor, stages, 0.0, _rounded_up(most, _COUNTED), step)
    if most < max(low, _COUNTED):
        return (dark,)
    return dark, _table(sensor, stages, max(low, _COUNTED), high, step)


def _full(sensor: Sensor, stages: Stages) -> tuple[float, float]:
    """Electrons from which a pixel may be clipped, and from which it surely is; both infinite
    where nothing clips."""
    if not stages.clipping:
        return math.inf, math.inf
    top = (2**sensor.bits - 1 - sensor.black_level) * sensor.gain
    noise = 9 * sensor.read_noise + 5 * sensor.dsnu + sensor.gain
    first = min(sensor.full_well, max(top - noise, 0.0))
    final = min(sensor.full_well, top + noise)
    return (
        max(first - _FULL * math.sqrt(first) - 50, 0.0),
        final + _FULL * math.sqrt(final) + 130,
    )


def _rounded_up(most: float, limit: float) -> float:
    """A round number for the end of a table, so that it serves for other pictures too."""
    return min(limit, 2.0 ** math.ceil(math.log2(max(most, 64.0))))


@functools.lru_cache(maxsize=16)
def _table(sensor: Sensor, stages: Stages, low: float, high: float, step: float) -> Table:
    return Table(sensor, stages, low, high, step)


class Table:
    """Means and variances by expected electrons and offset, for a sensor and its stages.

    low, high: electrons at both ends; beyond, it gives what they have. final: whether nothing
    changes beyond. step: electrons of a step of offset; 0 where there is none.
    """

    def __init__(
        self, sensor: Sensor, stages: Stages, low: float, high: float, step: float
    ) -> None:
        self.low, self.high = low, high
        self.final = high >= _full(sensor, stages)[1]
        self._start = math.sqrt(low + _START)
        count = math.ceil(_FINENESS * (math.sqrt(high + _START) - self._start)) + 4
        root = self._start + np.arange(count) / _FINENESS
        electrons = np.maximum(root**2 - _START, 0.0)
        self._reach = _FURTHEST_STEP if step else 0
        offsets = np.arange(-self._reach, self._reach + 1) * step
        first = window(electrons[0])[0]
        counts = np.arange(first, window(electrons[-1])[1] + 1, dtype=np.float64)
        if stages.clipping:
            counts = np.minimum(counts, sensor.full_well)
        read = read_out(counts[:, None] + offsets, sensor, stages)
        rows = [_over_chance(mean, first, *read, stages.shot) for mean in electrons]
        self.mean = _finer(np.array([row[0] for row in rows]))
        self.variance = _finer(np.array([row[1] for row in rows])).clamp(min=0.0)

    def __call__(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and variance of pixels, of any shape, float64."""
        flat = electrons.flatten()
        mean, variance = torch.empty_like(flat), torch.empty_like(flat)
        for start in range(0, flat.numel(), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            own = None if steps is None else steps.flatten()[part].to(torch.int64)
            mean[part], variance[part] = self._read(flat[part], own)
        return mean.reshape(electrons.shape), variance.reshape(electrons.shape)

    def steepest(self, most: float) -> tuple[float, float]:
        """The largest slopes, of any sign, of mean and variance by electrons, up to so many."""
        electrons = self._up_to(most)
        spaces = np.diff(electrons)[:, None]
        mean, variance = (
            np.abs(np.diff(values.numpy()[: len(electrons)], axis=0) / spaces).max()
            for values in (self.mean, self.variance)
        )
        return float(mean), float(variance)

    def least(self, most: float) -> float:
        """The least variance of up to so many electrons."""
        return float(self.variance[: len(self._up_to(most))].min())

    def _up_to(self, most: float) -> Numbers:
        """Nodes, two of them at least."""
        start, step = self._start, 1 / (_FINENESS * _FINER)
        electrons = (start + np.arange(len(self.mean)) * step) ** 2 - _START
        return electrons[electrons <= max(most, electrons[1])]

    def _read(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        start, step = self._start, 1 / (_FINENESS * _FINER)
        electrons = electrons.clamp(self.low, self.high)
        base = (electrons + _START).sqrt_().sub_(start).div_(step).floor_()
        base.clamp_(0, len(self.mean) - 2)
        root = base * step + start
        # Lines in electrons, not in their root: means are straight but at the ends.
        between = (electrons - (root**2 - _START)) / (step * (2 * root + step))
        columns = self.mean.shape[1]
        first = base.to(torch.int64).mul_(columns).add_(self._reach)
        if steps is not None:
            first += steps
        second = first + columns
        mean, variance = (
            torch.lerp(values.view(-1)[first], values.view(-1)[second], between)
            for values in (self.mean, self.variance)
        )
        return mean, variance


def _finer(values: Numbers) -> torch.Tensor:
    """A table with splines between its nodes, (nodes, columns)."""
    nodes = np.arange(len(values))
    inner = np.arange((len(values) - 1) * _FINER + 1) / _FINER
    return torch.from_numpy(CubicSpline(nodes, values)(inner))


_FURTHEST_STEP = 18
"""Steps of offset at most: 4.5 standard deviations of four steps, see fixed_pattern()."""


def _over_chance(
    mean: float, start: int, read: Numbers, variance: Numbers, shot: Shot
) -> tuple[Numbers, Numbers]:
    """Over all numbers of electrons: the law of total variance."""
    first, shares = likelihoods(float(mean), shot)
    part = slice(first - start, first - start + len(shares))
    whole = shares @ read[part]
    return whole, shares @ variance[part] + shares @ (read[part] - whole) ** 2
