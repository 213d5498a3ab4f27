"""Means and variances by expected electrons, for all pixels of a sensor."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from optics.sensor.converter import readout_moments
from optics.sensor.electron_counts import Numbers, count_probabilities, electron_range
from optics.sensor.sensor import Sensor
from optics.sensor.stages import ShotNoise, Stages

_NODES_PER_UNIT = 16
"""Nodes of a table for a unit of sqrt(electrons), which is two standard deviations."""

_ANSCOMBE_OFFSET = 3 / 8
"""Nodes are even in sqrt(electrons + this) (Anscombe 1948), where shot noise is even too."""

_MAX_TABULATED_ELECTRONS = 2.0**17
"""Electrons beyond which, unless they are clipped, rounding is far finer than shot noise."""

_SATURATION_DEVIATIONS = 9.0
"""Standard deviations around a limit beyond which a pixel surely is, or isn't, full."""

_SPLINE_REFINEMENT = 16
"""Times by which a table is made finer by splines, so that lines serve between its nodes."""

_BATCH_PIXELS = 1 << 17
"""Pixels that are worked out together: they stay in a processor's own memory."""


def moment_tables(
    sensor: Sensor, stages: Stages, max_electrons: float, electrons_per_step: float = 0.0
) -> tuple[MomentTable, ...]:
    """The tables that pixels of up to `max_electrons` electrons need, kept for the next.

    One from darkness on; where wells are deep, it ends where rounding is far finer than shot
    noise, and another one begins near the full well. Between them, mean and variance are those
    of plain shot noise. electrons_per_step: electrons of a step of offset; 0 where there is none.
    """
    stages = replace(stages, dark_current=True, fixed_pattern=True)
    low, high = _clipping_range(sensor, stages)
    if high <= _MAX_TABULATED_ELECTRONS:
        return (
            _cached_table(
                sensor, stages, 0.0, _round_up_limit(max_electrons, high), electrons_per_step
            ),
        )
    dark = _cached_table(
        sensor,
        stages,
        0.0,
        _round_up_limit(max_electrons, _MAX_TABULATED_ELECTRONS),
        electrons_per_step,
    )
    if max_electrons < max(low, _MAX_TABULATED_ELECTRONS):
        return (dark,)
    return dark, _cached_table(
        sensor, stages, max(low, _MAX_TABULATED_ELECTRONS), high, electrons_per_step
    )


def _clipping_range(sensor: Sensor, stages: Stages) -> tuple[float, float]:
    """Electrons from which a pixel may be clipped, and from which it surely is; both infinite
    where nothing clips."""
    if not stages.clipping:
        return math.inf, math.inf
    top = (2**sensor.bits - 1 - sensor.black_level) * sensor.gain
    noise = 9 * sensor.read_noise + 5 * sensor.dsnu + sensor.gain
    first = min(sensor.full_well, max(top - noise, 0.0))
    final = min(sensor.full_well, top + noise)
    return (
        max(first - _SATURATION_DEVIATIONS * math.sqrt(first) - 50, 0.0),
        final + _SATURATION_DEVIATIONS * math.sqrt(final) + 130,
    )


def _round_up_limit(max_electrons: float, limit: float) -> float:
    """A round number for the end of a table, so that it serves for other pictures too."""
    return min(limit, 2.0 ** math.ceil(math.log2(max(max_electrons, 64.0))))


@functools.lru_cache(maxsize=16)
def _cached_table(
    sensor: Sensor, stages: Stages, low: float, high: float, step: float
) -> MomentTable:
    return MomentTable(sensor, stages, low, high, step)


class MomentTable:
    """Means and variances by expected electrons and offset, for a sensor and its stages.

    low, high: electrons at both ends; beyond, it gives what they have. covers_saturation: whether
    nothing changes beyond. electrons_per_step: electrons of a step of offset; 0 where there is
    none.
    """

    def __init__(
        self, sensor: Sensor, stages: Stages, low: float, high: float, electrons_per_step: float
    ) -> None:
        self.low, self.high = low, high
        self.covers_saturation = high >= _clipping_range(sensor, stages)[1]
        self._start = math.sqrt(low + _ANSCOMBE_OFFSET)
        count = math.ceil(_NODES_PER_UNIT * (math.sqrt(high + _ANSCOMBE_OFFSET) - self._start)) + 4
        root = self._start + np.arange(count) / _NODES_PER_UNIT
        electrons = np.maximum(root**2 - _ANSCOMBE_OFFSET, 0.0)
        self._reach = _MAX_OFFSET_STEP if electrons_per_step else 0
        offsets = np.arange(-self._reach, self._reach + 1) * electrons_per_step
        first = electron_range(electrons[0])[0]
        counts = np.arange(first, electron_range(electrons[-1])[1] + 1, dtype=np.float64)
        if stages.clipping:
            counts = np.minimum(counts, sensor.full_well)
        read = readout_moments(counts[:, None] + offsets, sensor, stages)
        rows = [_average_over_counts(mean, first, *read, stages.shot) for mean in electrons]
        self.mean = _refine_by_splines(np.array([row[0] for row in rows]))
        self.variance = _refine_by_splines(np.array([row[1] for row in rows])).clamp(min=0.0)

    def __call__(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and variance of pixels, of any shape, float64."""
        flat = electrons.flatten()
        mean, variance = torch.empty_like(flat), torch.empty_like(flat)
        for start in range(0, flat.numel(), _BATCH_PIXELS):
            part = slice(start, start + _BATCH_PIXELS)
            own = None if steps is None else steps.flatten()[part].to(torch.int64)
            mean[part], variance[part] = self._interpolate(flat[part], own)
        return mean.reshape(electrons.shape), variance.reshape(electrons.shape)

    def max_slopes(self, max_electrons: float) -> tuple[float, float]:
        """The largest slopes, of any sign, of mean and variance by electrons, up to so many."""
        electrons = self._nodes_up_to(max_electrons)
        spaces = np.diff(electrons)[:, None]
        mean, variance = (
            np.abs(np.diff(values.numpy()[: len(electrons)], axis=0) / spaces).max()
            for values in (self.mean, self.variance)
        )
        return float(mean), float(variance)

    def min_variance(self, max_electrons: float) -> float:
        """The least variance of up to so many electrons."""
        return float(self.variance[: len(self._nodes_up_to(max_electrons))].min())

    def _nodes_up_to(self, max_electrons: float) -> Numbers:
        """Nodes, two of them at least."""
        start, step = self._start, 1 / (_NODES_PER_UNIT * _SPLINE_REFINEMENT)
        electrons = (start + np.arange(len(self.mean)) * step) ** 2 - _ANSCOMBE_OFFSET
        return electrons[electrons <= max(max_electrons, electrons[1])]

    def _interpolate(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        start, step = self._start, 1 / (_NODES_PER_UNIT * _SPLINE_REFINEMENT)
        electrons = electrons.clamp(self.low, self.high)
        base = (electrons + _ANSCOMBE_OFFSET).sqrt_().sub_(start).div_(step).floor_()
        base.clamp_(0, len(self.mean) - 2)
        root = base * step + start
        # Lines in electrons, not in their root: means are straight but at the ends.
        between = (electrons - (root**2 - _ANSCOMBE_OFFSET)) / (step * (2 * root + step))
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


def _refine_by_splines(values: Numbers) -> torch.Tensor:
    """A table with splines between its nodes, (nodes, columns)."""
    nodes = np.arange(len(values))
    inner = np.arange((len(values) - 1) * _SPLINE_REFINEMENT + 1) / _SPLINE_REFINEMENT
    return torch.from_numpy(CubicSpline(nodes, values)(inner))


_MAX_OFFSET_STEP = 18
"""Steps of offset at most: 4.5 standard deviations of four steps, see fixed_pattern()."""


def _average_over_counts(
    mean: float, start: int, read: Numbers, variance: Numbers, shot: ShotNoise
) -> tuple[Numbers, Numbers]:
    """Over all numbers of electrons: the law of total variance."""
    first, shares = count_probabilities(float(mean), shot)
    part = slice(first - start, first - start + len(shares))
    whole = shares @ read[part]
    return whole, shares @ variance[part] + shares @ (read[part] - whole) ** 2
