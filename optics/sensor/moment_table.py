"""Tabulate mean and variance of a sensor's pixels by their expected electrons."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from optics.sensor.converter import readout_moments
from optics.sensor.electron_counts import CountProbabilities, Numbers
from optics.sensor.fixed_pattern import MAX_OFFSET_STEP
from optics.sensor.sensor import Sensor
from optics.sensor.stages import Stages

_ANSCOMBE_OFFSET = 3 / 8
"""Offset in electrons. Nodes are evenly spaced in sqrt(electrons + offset), because the shot noise
of that quantity is constant (Anscombe 1948)."""

_MAX_TABULATED_ELECTRONS = 2.0**17
"""Electrons beyond which rounding is far finer than shot noise, so that no table is needed unless
pixels clip."""

_NODES_TOGETHER = 16
"""Neighbouring nodes of a table that are computed together: two standard deviations. Chosen."""

BATCH_PIXELS = 1 << 17
"""Pixels that are computed together; they stay in a processor's cache."""


@dataclass(frozen=True)
class MomentTableSettings:
    """Tune the tables of a sensor's mean and variance.

    Attributes
    ----------
    nodes_per_unit : int
        Computed nodes per unit of sqrt(electrons), which is two standard deviations. Chosen.
    spline_refinement : int
        Factor by which splines refine the table, so that linear interpolation is enough between the
        refined nodes. Chosen.
    saturation_deviations : float
        Standard deviations of shot noise from a limit, beyond which a pixel is certainly full or
        certainly not. Chosen.
    """

    nodes_per_unit: int = 16
    spline_refinement: int = 16
    saturation_deviations: float = 9.0

    @property
    def step(self) -> float:
        """The distance between a sensor moment table's refined nodes, in sqrt(electrons)."""
        return 1 / (self.nodes_per_unit * self.spline_refinement)


_SETTINGS = MomentTableSettings()


def moment_tables(
    sensor: Sensor, stages: Stages, max_electrons: float, electrons_per_step: float = 0.0
) -> tuple[MomentTable, ...]:
    """Return a sensor's tables of mean and variance up to `max_electrons`, from a cache.

    The first table begins at darkness. For a deep well, it ends where rounding is far finer than
    shot noise, and a second table begins near the full well. Between them, mean and variance are
    those of shot noise alone. electrons_per_step: electrons per step of a pixel's offset; 0 without
    offsets.
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
    """Return the electrons from which a sensor pixel may clip, and from which it certainly clips.

    Both are infinite if clipping isn't simulated.
    """
    if not stages.clipping:
        return math.inf, math.inf
    top = (sensor.top_number - sensor.black_level) * sensor.gain
    noise = 9 * sensor.read_noise + 5 * sensor.dsnu + sensor.gain
    first = min(sensor.full_well, max(top - noise, 0.0))
    final = min(sensor.full_well, top + noise)
    deviations = _SETTINGS.saturation_deviations
    return (
        max(first - deviations * math.sqrt(first) - 50, 0.0),
        final + deviations * math.sqrt(final) + 130,
    )


def _round_up_limit(max_electrons: float, limit: float) -> float:
    """Round the end of a sensor's moment table, in electrons, up to a power of two.

    Other pictures can then use the same table.
    """
    return min(limit, 2.0 ** math.ceil(math.log2(max(max_electrons, 64.0))))


@functools.lru_cache(maxsize=16)
def _cached_table(
    sensor: Sensor, stages: Stages, low: float, high: float, step: float
) -> MomentTable:
    return MomentTable(sensor, stages, low, high, step)


class MomentTable:
    """Tabulates a pixel's mean and variance by expected electrons and offset, for a sensor.

    low, high: electrons at both ends; beyond them, the values at the ends are used.
    covers_saturation: whether the values no longer change beyond `high`. electrons_per_step:
    electrons per step of a pixel's offset; 0 without offsets.
    """

    def __init__(
        self, sensor: Sensor, stages: Stages, low: float, high: float, electrons_per_step: float
    ) -> None:
        self.low, self.high = low, high
        self.covers_saturation = high >= _clipping_range(sensor, stages)[1]
        self._start = math.sqrt(low + _ANSCOMBE_OFFSET)
        per_unit = _SETTINGS.nodes_per_unit
        count = math.ceil(per_unit * (math.sqrt(high + _ANSCOMBE_OFFSET) - self._start)) + 4
        root = self._start + np.arange(count) / per_unit
        electrons = np.maximum(root**2 - _ANSCOMBE_OFFSET, 0.0)
        self._reach = MAX_OFFSET_STEP if electrons_per_step else 0
        offsets = np.arange(-self._reach, self._reach + 1) * electrons_per_step
        probabilities = CountProbabilities(float(electrons[0]), float(electrons[-1]), stages.shot)
        counts = probabilities.counts
        if stages.clipping:
            counts = np.minimum(counts, sensor.full_well)
        read = readout_moments(counts[:, None] + offsets, sensor, stages)
        parts = np.split(electrons, np.arange(_NODES_TOGETHER, count, _NODES_TOGETHER))
        rows = [_average_over_counts(probabilities, means, *read) for means in parts]
        self.mean = _refine_by_splines(np.concatenate([row[0] for row in rows]))
        variance = np.concatenate([row[1] for row in rows])
        self.variance = _refine_by_splines(variance).clamp(min=0.0)

    def __call__(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Look up mean and variance of pixels, of any shape, float64.

        electrons: expected. steps: the pixels' offsets in steps, or None.
        """
        flat = electrons.flatten()
        mean, variance = torch.empty_like(flat), torch.empty_like(flat)
        for start in range(0, flat.numel(), BATCH_PIXELS):
            part = slice(start, start + BATCH_PIXELS)
            own = None if steps is None else steps.flatten()[part].to(torch.int64)
            mean[part], variance[part] = self._interpolate(flat[part], own)
        return mean.reshape(electrons.shape), variance.reshape(electrons.shape)

    def max_slopes(self, max_electrons: float) -> tuple[float, float]:
        """Return the largest slopes of a sensor pixel's mean and variance over electrons.

        The slopes are absolute values, up to `max_electrons`.
        """
        electrons = self._nodes_up_to(max_electrons)
        spaces = np.diff(electrons)[:, None]
        mean, variance = (
            np.abs(np.diff(values.numpy()[: len(electrons)], axis=0) / spaces).max()
            for values in (self.mean, self.variance)
        )
        return float(mean), float(variance)

    def min_variance(self, max_electrons: float) -> float:
        """Return a sensor pixel's least variance up to `max_electrons`, from the table."""
        return float(self.variance[: len(self._nodes_up_to(max_electrons))].min())

    def _nodes_up_to(self, max_electrons: float) -> Numbers:
        """Return a sensor moment table's nodes up to `max_electrons`, two at least."""
        start, step = self._start, _SETTINGS.step
        electrons = (start + np.arange(len(self.mean)) * step) ** 2 - _ANSCOMBE_OFFSET
        return electrons[electrons <= max(max_electrons, electrons[1])]

    def _interpolate(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        start, step = self._start, _SETTINGS.step
        electrons = electrons.clamp(self.low, self.high)
        base = (electrons + _ANSCOMBE_OFFSET).sqrt_().sub_(start).div_(step).floor_()
        base.clamp_(0, len(self.mean) - 2)
        root = base * step + start
        # Interpolation is linear in electrons, not in their root, because means are proportional to
        # electrons except at the ends.
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
    """Refine a sensor's moment table, (nodes, columns), by splines between its nodes."""
    nodes, finer = np.arange(len(values)), _SETTINGS.spline_refinement
    inner = np.arange((len(values) - 1) * finer + 1) / finer
    return torch.from_numpy(CubicSpline(nodes, values)(inner))


def _average_over_counts(
    probabilities: CountProbabilities, means: Numbers, read: Numbers, variance: Numbers
) -> tuple[Numbers, Numbers]:
    """Average sensor pixels' mean and variance over shot noise, by the law of total variance.

    means: of electrons, close together. The results are (means, offsets).
    """
    part, shares = probabilities(means)
    # Squares are of numbers near 0, so that their difference has as many digits.
    middle = shares[len(means) // 2] @ read[part]
    away = read[part] - middle
    moved = shares @ away
    return middle + moved, shares @ (variance[part] + away**2) - moved**2
