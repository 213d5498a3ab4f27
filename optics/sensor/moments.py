"""Compute mean and variance of every pixel's number, by tables over its expected electrons."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import gammaln, ndtr

from optics.sensor.sensor import Sensor
from optics.sensor.stages import (
    FEW_ELECTRONS,
    MAX_OFFSET_STEP,
    CollectedCharge,
    ShotNoise,
    Stages,
    collect_electrons,
)

Numbers = NDArray[np.float64]


def _electron_range(mean: float) -> tuple[int, int]:
    """Return the least and most photoelectrons that have a noticeable probability."""
    # Nine standard deviations are enough. The 20 serve few expected electrons.
    reach = 9.0 * math.sqrt(mean) + 20
    return max(0, math.floor(mean - reach)), math.ceil(mean + reach)


class _CountProbabilities:
    """Probabilities of photoelectron counts, for means from `least` to `most`.

    Logarithms of factorials are computed once for all means.
    """

    def __init__(self, least: float, most: float, shot: ShotNoise) -> None:
        self._shot, self._first = shot, _electron_range(least)[0]
        self.counts = np.arange(self._first, _electron_range(most)[1] + 1, dtype=np.float64)
        self._log_factorials = gammaln(self.counts + 1)

    def __call__(self, means: Numbers) -> tuple[slice, Numbers]:
        """Return which counts pixels may hold, as a slice of `counts`, and their probabilities.

        means: rising. The probabilities are (means, counts), for few means that are close together.
        """
        first, last = _electron_range(float(means[0]))[0], _electron_range(float(means[-1]))[1]
        part = slice(first - self._first, last + 1 - self._first)
        counts, lit = self.counts[part], means[:, None] > 0
        mean = np.where(lit, means[:, None], 1.0)
        if self._shot == "Gaussian":
            # Counts are rounded from a normal distribution, and negative numbers count as 0.
            spread = mean / np.sqrt(mean + 1 / 12)
            below = ndtr((np.append(counts, counts[-1] + 1) - 0.5 - mean) / spread)
            if counts[0] == 0:
                below[:, 0] = 0.0
            shares = np.diff(below, axis=1)
        else:
            shares = np.exp(counts * np.log(mean) - mean - self._log_factorials[part])
        shares = np.where(lit, shares, counts == 0)
        return part, shares / shares.sum(axis=1, keepdims=True)


_MAX_DEVIATIONS = 8.5  # of read noise that are summed; 1e-17 of the probability lies beyond


def _readout_moments(electrons: Numbers, sensor: Sensor, stages: Stages) -> tuple[Numbers, Numbers]:
    """Compute mean and variance, in electrons, of a pixel's readout through noise and ADC.

    The electrons are those in the well, with the pixel's offset. The readout is (number - black
    level) times the gain, clipped and rounded as `stages` says.
    """
    noise = sensor.read_noise if stages.read_noise else 0.0
    if stages.quantisation:
        scaled = electrons / sensor.gain + sensor.black_level
        mean, variance = _rounded_moments(scaled, noise / sensor.gain, sensor, stages.clipping)
        return (mean - sensor.black_level) * sensor.gain, variance * sensor.gain**2
    if stages.clipping:
        low = -sensor.black_level * sensor.gain
        return _clipped_moments(electrons, noise, low, low + sensor.top_number * sensor.gain)
    return electrons, np.full_like(electrons, noise**2)


def _clipped_moments(x: Numbers, noise: float, low: float, high: float) -> tuple[Numbers, Numbers]:
    """Compute mean and variance of a normal number of mean x that is clipped at both ends."""
    if not noise:
        return np.clip(x, low, high), np.zeros_like(x)
    a, b = (low - x) / noise, (high - x) / noise
    under, over = ndtr(a), ndtr(-b)
    inside = 1 - under - over
    density_a, density_b = (
        np.exp(-0.5 * np.minimum(z**2, 1400.0)) / math.sqrt(2 * math.pi) for z in (a, b)
    )
    shift = noise * (density_a - density_b + a * under + b * over)
    square = noise**2 * (inside + a * density_a - b * density_b + a**2 * under + b**2 * over)
    return x + shift, np.maximum(square - shift**2, 0.0)


def _rounded_moments(
    scaled: Numbers, noise: float, sensor: Sensor, clipping: bool
) -> tuple[Numbers, Numbers]:
    """Compute mean and variance of a normal number of mean `scaled` that the ADC rounds.

    Both are sums over the probabilities that the number reaches each whole step.
    """
    top = sensor.top_number
    if not noise:
        number = np.round(scaled)
        return np.clip(number, 0, top) if clipping else number, np.zeros_like(scaled)
    first = np.floor(scaled - _MAX_DEVIATIONS * noise - 0.5)
    base = np.clip(first, 0, top) if clipping else first
    mean, square = np.zeros_like(scaled), np.zeros_like(scaled)
    for step in range(1, math.ceil(2 * _MAX_DEVIATIONS * noise) + 3):
        number = first + step
        reached = ndtr((scaled - number + 0.5) / noise)
        if clipping:
            reached = np.where((number >= 1) & (number <= top), reached, 0.0)
        mean += reached
        square += (2 * (number - base) - 1) * reached
    return base + mean, np.maximum(square - mean**2, 0.0)


# Offset in electrons. Nodes are evenly spaced in sqrt(electrons + offset), because the shot noise
# of that quantity is constant (Anscombe 1948).
_ANSCOMBE_OFFSET = 3 / 8

# Electrons beyond which rounding is far finer than shot noise, so that no table is needed unless
# pixels clip.
_MAX_TABULATED_ELECTRONS = 2.0**17

_NODES_TOGETHER = 16  # nodes that are computed together: two standard deviations; chosen
_BATCH_PIXELS = 1 << 17  # computed together; they stay in a processor's cache
_NODES_PER_UNIT = 16  # of sqrt(electrons), which is two standard deviations; chosen
_REFINEMENT = 16  # by splines, so that linear interpolation is enough in between; chosen
_STEP = 1 / (_NODES_PER_UNIT * _REFINEMENT)  # between the refined nodes, in sqrt(electrons)
_SATURATION_DEVIATIONS = 9.0  # of shot noise from a limit: certainly full or not beyond; chosen


def moment_tables(
    sensor: Sensor, stages: Stages, max_electrons: float, electrons_per_step: float = 0.0
) -> tuple[MomentTable, ...]:
    """Return the tables of mean and variance up to `max_electrons`, from a cache.

    The first table begins at darkness. For a deep well, it ends where rounding is far finer than
    shot noise, and a second table begins near the full well. Between them, mean and variance are
    those of shot noise alone. electrons_per_step: electrons per step of a pixel's offset; 0 without
    offsets.
    """
    stages = replace(stages, dark_current=True, fixed_pattern=True)
    low, high = _clipping_range(sensor, stages)
    bright = max(low, _MAX_TABULATED_ELECTRONS)
    # The end is rounded up to a power of two, so that other pictures can use the same table.
    end = min(high, _MAX_TABULATED_ELECTRONS, 2.0 ** math.ceil(math.log2(max(max_electrons, 64.0))))
    dark = _cached_table(sensor, stages, 0.0, end, electrons_per_step)
    if high <= _MAX_TABULATED_ELECTRONS or max_electrons < bright:
        return (dark,)
    return dark, _cached_table(sensor, stages, bright, high, electrons_per_step)


def _clipping_range(sensor: Sensor, stages: Stages) -> tuple[float, float]:
    """Return the electrons from which a pixel may clip, and from which it certainly clips.

    Both are infinite if clipping isn't simulated.
    """
    if not stages.clipping:
        return math.inf, math.inf
    top = (sensor.top_number - sensor.black_level) * sensor.gain
    noise = 9 * sensor.read_noise + 5 * sensor.dsnu + sensor.gain
    first = min(sensor.full_well, max(top - noise, 0.0))
    final = min(sensor.full_well, top + noise)
    low = max(first - _SATURATION_DEVIATIONS * math.sqrt(first) - 50, 0.0)
    return low, final + _SATURATION_DEVIATIONS * math.sqrt(final) + 130


class MomentTable:
    """A pixel's mean and variance by expected electrons and offset.

    Beyond `low` and `high` electrons, the values at the ends are used; `covers_saturation` tells
    whether they no longer change beyond `high`.
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
        self._reach = MAX_OFFSET_STEP if electrons_per_step else 0
        offsets = np.arange(-self._reach, self._reach + 1) * electrons_per_step
        probabilities = _CountProbabilities(float(electrons[0]), float(electrons[-1]), stages.shot)
        counts = probabilities.counts
        if stages.clipping:
            counts = np.minimum(counts, sensor.full_well)
        read = _readout_moments(counts[:, None] + offsets, sensor, stages)
        parts = np.split(electrons, np.arange(_NODES_TOGETHER, count, _NODES_TOGETHER))
        rows = [_average_over_counts(probabilities, means, *read) for means in parts]
        self.mean = _refine_by_splines(np.concatenate([row[0] for row in rows]))
        variance = np.concatenate([row[1] for row in rows])
        self.variance = _refine_by_splines(variance).clamp(min=0.0)

    def __call__(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Look up mean and variance of pixels by expected electrons, of any shape, and offsets."""
        flat = electrons.flatten()
        mean, variance = torch.empty_like(flat), torch.empty_like(flat)
        for start in range(0, flat.numel(), _BATCH_PIXELS):
            part = slice(start, start + _BATCH_PIXELS)
            own = None if steps is None else steps.flatten()[part].to(torch.int64)
            mean[part], variance[part] = self._interpolate(flat[part], own)
        return mean.reshape(electrons.shape), variance.reshape(electrons.shape)

    def max_slopes(self, max_electrons: float) -> tuple[float, float]:
        """Return the largest absolute slopes of mean and variance over electrons, up to a limit."""
        electrons = self._nodes_up_to(max_electrons)
        spaces = np.diff(electrons)[:, None]
        mean, variance = (
            np.abs(np.diff(values.numpy()[: len(electrons)], axis=0) / spaces).max()
            for values in (self.mean, self.variance)
        )
        return float(mean), float(variance)

    def min_variance(self, max_electrons: float) -> float:
        """Return the least variance up to `max_electrons`, from the table."""
        return float(self.variance[: len(self._nodes_up_to(max_electrons))].min())

    def _nodes_up_to(self, max_electrons: float) -> Numbers:
        """Return the table's nodes up to `max_electrons`, two at least."""
        root = self._start + np.arange(len(self.mean)) * _STEP
        electrons = root**2 - _ANSCOMBE_OFFSET
        return electrons[electrons <= max(max_electrons, electrons[1])]

    def _interpolate(
        self, electrons: torch.Tensor, steps: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        electrons = electrons.clamp(self.low, self.high)
        base = (electrons + _ANSCOMBE_OFFSET).sqrt_().sub_(self._start).div_(_STEP).floor_()
        base.clamp_(0, len(self.mean) - 2)
        root = base * _STEP + self._start
        # Interpolation is linear in electrons, not in their root, because means are proportional to
        # electrons except at the ends.
        between = (electrons - (root**2 - _ANSCOMBE_OFFSET)) / (_STEP * (2 * root + _STEP))
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


_cached_table = functools.lru_cache(maxsize=16)(MomentTable)


def _refine_by_splines(values: Numbers) -> torch.Tensor:
    """Refine a table, (nodes, columns), by splines between its nodes."""
    inner = np.arange((len(values) - 1) * _REFINEMENT + 1) / _REFINEMENT
    return torch.from_numpy(CubicSpline(np.arange(len(values)), values)(inner))


def _average_over_counts(
    probabilities: _CountProbabilities, means: Numbers, read: Numbers, variance: Numbers
) -> tuple[Numbers, Numbers]:
    """Average mean and variance over shot noise, by the law of total variance.

    means: of electrons, close together. The results are (means, offsets).
    """
    part, shares = probabilities(means)
    # Squares are of numbers near 0, so that their difference has as many digits.
    middle = shares[len(means) // 2] @ read[part]
    away = read[part] - middle
    moved = shares @ away
    return middle + moved, shares @ (variance[part] + away**2) - moved**2


def moments(
    electrons: torch.Tensor,
    exposure: float,
    sensor: Sensor,
    **switches: Any,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute mean and variance of every pixel's digital number, without sampling a frame.

    The moments describe the frames of `sample_frame`. They are sums over all numbers of electrons
    and all digital numbers, tabulated and interpolated, with a relative error of 1e-4. They refer
    to (number - black level) · gain.

    Parameters
    ----------
    electrons, exposure, sensor : torch.Tensor, (rows, columns), float, Sensor
        Electrons expected from light on each pixel over the exposure, seconds, and the sensor.
    **switches : bool or str
        Which stages are simulated: the fields of `Stages`. "skewed" shot noise counts as Poisson's.

    Returns
    -------
    mean, variance : torch.Tensor, (rows, columns), float64
        Electrons, and electrons².

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
    """Compute each pixel's mean and variance by itself, where there is no shot noise."""
    full = charge.electrons
    if stages.clipping:
        full = full.clamp(max=sensor.full_well)
    flat = (full + charge.offset).flatten()
    starts = range(0, flat.numel(), _BATCH_PIXELS)
    parts = [_readout_moments(flat[n : n + _BATCH_PIXELS].numpy(), sensor, stages) for n in starts]
    mean, variance = (torch.from_numpy(np.concatenate(one)) for one in zip(*parts, strict=True))
    return mean.reshape(full.shape), variance.reshape(full.shape)


def _tabulated_moments(
    charge: CollectedCharge, sensor: Sensor, stages: Stages
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return each pixel's mean and variance from tables over the expected photoelectrons."""
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
