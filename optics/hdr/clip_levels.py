"""Count an exposure where its pixels may be clipped, without bias."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from optics.hdr.bracket import Bracket, Exposure
from optics.hdr.weighted_mean import Mask, WeightedMean, outlier_limit
from optics.threads import single_threaded

Array = NDArray[np.float64]

NEAR = 7.0
"""Standard deviations from the clip level within which an exposure may be clipped, or not."""

_STEP = 0.1  # standard deviations: spacing of the functions' nodes; chosen
# Functions for each factor of e in s: the error of a coarser s is 1 %; chosen
_STEPS_PER_FACTOR = 20


@dataclass(frozen=True, eq=False)
class NearClipping:
    """Estimates near a clip level as functions, in units of the exposure's noise.

    shorter: deviation of all shorter exposures together, over that of the exposure. open: nodes of
    m, the mean of both, where the exposure isn't clipped. clipped: nodes of the shorter exposures'
    value where it is. open_value, clipped_value: estimates there. open_variance, clipped_variance:
    variances that are stated with them.
    """

    shorter: float
    open: Array
    open_value: Array
    open_variance: Array
    clipped: Array
    clipped_value: Array
    clipped_variance: Array

    def from_open(self, mean: Array) -> tuple[Array, Array]:
        """Return estimate and variance where the frame isn't clipped, from the mean of both."""
        value = np.interp(mean, self.open, self.open_value - self.open, left=0.0) + mean
        natural = self.shorter**2 / (1 + self.shorter**2)
        return value, np.interp(mean, self.open, self.open_variance, left=natural)

    def from_clipped(self, shorter: Array) -> tuple[Array, Array]:
        """Return estimate and variance where the frame is clipped, from the shorter ones' value."""
        value = np.interp(shorter, self.clipped, self.clipped_value)
        above = shorter >= self.clipped[-1]
        return np.where(above, shorter, value), np.interp(
            shorter, self.clipped, self.clipped_variance, right=self.shorter**2
        )


def near_clipping(shorter: float) -> NearClipping:
    """Return the estimates near a clip level.

    shorter: standard deviation of all shorter exposures together, over that of the exposure.
    """
    step = round(_STEPS_PER_FACTOR * math.log(min(max(shorter, 0.05), 50.0)))
    return _design_estimates(step)


def least_variance(light: Array, shorter: float) -> Array:
    """Return the Cramér-Rao bound near a clip level, in units of the exposure's variance.

    light: in standard deviations above the clip level. The clipped exposure counts as one whose
    value is only known to be above.
    """
    z = np.clip(-light, -30, 30)
    below, density = ndtr(z), np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    hazard = np.exp(-(z**2) / 2 - log_ndtr(-z)) / math.sqrt(2 * math.pi)
    return np.asarray(1 / (1 / shorter**2 + below - density * (z - hazard)))


@lru_cache(maxsize=64)
@single_threaded
def _design_estimates(step: int) -> NearClipping:
    """Choose the estimates near a clip level by least squares."""
    shorter = math.exp(step / _STEPS_PER_FACTOR)
    # Where the shorter exposures are much noisier, changes are spread over as much.
    wide = _STEP * max(1.0, min(shorter, 4.0))
    top = NEAR + 8 * shorter
    light = np.concatenate([np.arange(-NEAR, NEAR, _STEP), np.arange(NEAR, top, wide)])
    share = np.gradient(light) / _STEP
    both = shorter / math.sqrt(1 + shorter**2)
    is_open = np.arange(-NEAR - 4, 3, _STEP)
    is_clipped = np.arange(-4 * shorter - 2, top, wide)
    # Of m alone, y has the variance 1 - both², whatever the light is.
    spread = math.sqrt(max(1 - both**2, 1e-12))
    chance_open = _density(is_open, light, both) * _STEP * ndtr(-is_open / spread)
    chance_clipped = _density(is_clipped, light, shorter) * wide * ndtr(light)[:, None]
    chance = np.concatenate([chance_open, chance_clipped], axis=1)
    nodes = np.concatenate([is_open, is_clipped])
    # The variance of light that shorter frames and clipping leave is that of a normal distribution
    # times ndtr(light), the chance of clipping.
    place = is_clipped / math.sqrt(1 + shorter**2)
    hazard = np.exp(-(place**2) / 2 - log_ndtr(place)) / math.sqrt(2 * math.pi)
    if_clipped = shorter**2 - shorter**4 / (1 + shorter**2) * hazard * (hazard + place)
    natural = np.concatenate([np.full(len(is_open), both**2), if_clipped])
    bending = _bending(len(is_open), 1.0, len(is_clipped), wide / _STEP)
    value, error = _least_error(light, share, shorter, chance, nodes, bending)
    variance = _stated_variance(error, share, chance, natural, bending)
    # Beyond the light that was looked at, the exposure is surely open, or surely clipped.
    cut = is_open < -NEAR + 1
    value[: len(is_open)][cut], variance[: len(is_open)][cut] = is_open[cut], both**2
    kept = is_clipped < NEAR + 5 * shorter
    count = len(is_open)
    return NearClipping(
        shorter, is_open, value[:count], variance[:count],
        is_clipped[kept], value[count:][kept], variance[count:][kept],
    )  # fmt: skip


def _density(nodes: Array, light: Array, deviation: float) -> Array:
    """Return the normal density at nodes around each light, (light, nodes)."""
    away = (nodes - light[:, None]) / deviation
    return np.asarray(np.exp(-(away**2) / 2) / (math.sqrt(2 * math.pi) * deviation))


def _least_error(
    light: Array, share: Array, shorter: float, chance: Array, nodes: Array, bending: Array
) -> tuple[Array, Array]:
    """Return the estimates at the nodes, and their mean squared error for each light.

    share: weight of each light. chance: of each node, for each light.
    """
    weight = share / least_variance(light, shorter)
    against_bias = 300 * max(1.0, (shorter / 2) ** 2)
    weighed = (weight[:, None] * chance).T
    matrix = against_bias * _product(weighed, chance) + 1e-3 * bending
    matrix[np.diag_indices_from(matrix)] += weighed.sum(1) + 1e-4
    known = chance.sum(1)
    wanted = weighed @ light - weighed.sum(1) * nodes
    wanted -= against_bias * weighed @ (chance @ nodes - known * light)
    value = nodes + _solve(matrix, wanted)
    return value, (chance * (value - light[:, None]) ** 2).sum(1)


def _stated_variance(
    error: Array, share: Array, chance: Array, natural: Array, bending: Array
) -> Array:
    """Return variances at the nodes whose mean is the mean squared error for each light.

    natural: variances far from the clip level, from which they differ no more than that takes.
    """
    weighed = chance * (np.sqrt(share) / error)[:, None]
    matrix = _product(weighed.T, weighed) + 0.03 * bending / np.median(natural) ** 2
    matrix[np.diag_indices_from(matrix)] += 1e-3 / natural**2
    change = _solve(matrix, weighed.T @ (np.sqrt(share) - weighed @ natural))
    return np.maximum(natural + change, 0.2 * np.minimum(natural, 1.0))


def _product(first: Array, second: Array) -> Array:
    """Multiply two matrices on torch's threads.

    The threads of numpy's own library wait in loops: on a busy machine they took ten times longer.
    """
    return np.asarray(torch.from_numpy(first) @ torch.from_numpy(second))


def _solve(matrix: Array, wanted: Array) -> Array:
    """Solve linear equations on torch's threads."""
    return np.asarray(torch.linalg.solve(torch.from_numpy(matrix), torch.from_numpy(wanted)))


def _bending(first: int, spacing: float, second: int, other_spacing: float) -> Array:
    """Return the matrix of the squared second differences of two functions in a row."""
    whole = np.zeros((first + second, first + second))
    for start, count, step in ((0, first, spacing), (first, second, other_spacing)):
        change = np.diff(np.eye(count), 2, axis=0) / step**2
        whole[start : start + count, start : start + count] = _product(change.T, change) * step
    return whole


_SAFE = 8.0  # deviations below the clip level from which an exposure surely isn't clipped
_MAY_CLIP = 5.0  # deviations from the shortest exposure's clip level within which a pixel may clip


@dataclass(frozen=True)
class ClipLevel:
    """The clip level of an exposure, and what all shorter ones know of light there.

    number: of the exposure in the bracket, 0 for the shortest.
    """

    bracket: Bracket
    number: int

    @property
    def exposure(self) -> Exposure:
        """The exposure that clips there."""
        return self.bracket.exposures[self.number]

    @cached_property
    def shorter(self) -> float:
        """Deviation of all shorter exposures together, over that of a frame.

        It is that of the rate from them where the frame clips.
        """
        exposure, information = self.exposure, 0.0
        rate = exposure.clip_level / exposure.time
        for one in self.bracket.exposures[: self.number]:
            each = (rate * one.time + one.floor) / len(one.frames) + one.floor / one.darks
            information += one.time**2 / each
        own = exposure.clip_level + exposure.floor * (1 + 1 / exposure.darks)
        return exposure.time / math.sqrt(information * own)

    @cached_property
    def deviation(self) -> float:
        """Standard deviation of a frame at the clip level, electrons."""
        exposure = self.exposure
        return math.sqrt(exposure.clip_level + exposure.floor * (1 + 1 / exposure.darks))

    @cached_property
    def lowest(self) -> np.float32:
        """Rate from which light doesn't surely lie below the clip level."""
        # Where the exposure is clipped, the value comes from the shorter ones, and errs as they do.
        return self._rate_below(_SAFE / 2 * (1 + math.sqrt(1 + self.shorter**2)))

    @cached_property
    def highest(self) -> np.float32:
        """Rate from which a clipped frame tells nothing that wasn't known."""
        light = self.exposure.clip_level + self.deviation * (NEAR + 5 * self.shorter)
        return np.float32(light / self.exposure.time)

    @property
    def may_clip(self) -> np.float32:
        """Rate from which chance may clip a frame."""
        return self._rate_below(_MAY_CLIP)

    def _rate_below(self, away: float) -> np.float32:
        """Return the rate whose light is `away` of its own deviations below the clip level."""
        level, floor = self.exposure.clip_level, self.exposure.floor
        # light + away · √(light + floor) = level
        light = level + away**2 / 2 - away * math.sqrt(away**2 / 4 + level + floor)
        return np.float32(light / self.exposure.time)

    def all_open(self, time: NDArray[np.float32]) -> Mask:
        """Return where no frame is clipped; time: total of the frames that are open, seconds."""
        return time > (len(self.exposure.frames) - 0.5) * self.exposure.time


def add_near_clipping(
    level: ClipLevel, rows: slice, near: NDArray[np.intp], mean: WeightedMean
) -> Mask:
    """Add an exposure that may be clipped to the mean, frame by frame, in place.

    near: indices of the pixels. Returns where a frame contradicts the values of shorter exposures,
    and was left out.
    """
    exposure, shorter = level.exposure, level.shorter
    known, stated = (one[near].astype(np.float64) for one in mean)
    moved, limit = np.zeros(known.shape, dtype=bool), outlier_limit(len(level.bracket.exposures))
    for index in exposure.frames:
        light, clipped = level.bracket.electrons(index, rows, chosen=near)
        estimate = near_clipping(shorter)
        place = (known * exposure.time - exposure.clip_level) / level.deviation
        own_place = (light - exposure.clip_level) / level.deviation
        share = 1 / (1 + shorter**2)
        both = share * place + (1 - share) * own_place
        away = np.where(clipped, -place, np.abs(own_place - place))
        contradicts = away > limit * math.sqrt(1 + shorter**2)
        moved |= contradicts
        counts = ~contradicts & np.where(clipped, place < NEAR + 5 * shorter, both < NEAR)
        value, variance = (
            np.where(clipped, one, other)
            for one, other in zip(
                estimate.from_clipped(place), estimate.from_open(both), strict=True
            )
        )
        found = value * level.deviation + exposure.clip_level
        known = np.where(counts, found / exposure.time, known)
        # The noise isn't quite that at the clip level.
        each = np.maximum(known, 0) * exposure.time + exposure.floor * (1 + 1 / exposure.darks)
        natural = stated + np.where(clipped, 0, exposure.time**2 / each)
        with_open = shorter / math.sqrt(1 + shorter**2)
        at_level = np.where(clipped, shorter, with_open) ** 2
        stated = np.where(counts, natural * at_level / variance, stated)
        shorter = with_open
    mean.rate[near], mean.information[near] = known, stated
    return moved
