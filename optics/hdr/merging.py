"""Merge the frames of an exposure bracket into radiance with variance and state."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import ndtri

from optics.hdr.bracket import Bracket, Exposure
from optics.hdr.near_clipping import NEAR, near_clipping
from optics.hdr.radiance import (
    CLIPPED,
    DARK,
    DEFECTIVE,
    MAY_CLIP,
    MOVED,
    VALID,
    RadianceEstimate,
)

Array = NDArray[np.float32]
Method = Literal["plain", "Poisson", "Granados", "full"]

METHODS: tuple[Method, ...] = get_args(Method)
"""Ways to merge, the quickest first."""

_TILE = 1 << 15
"""Pixels that are merged together: so few that all their numbers stay in a core's memory."""

_PASSES = 2
"""Passes in which the photons' variance is predicted from the merged value. More changed nothing
in brackets of two to eight exposures."""

_SAFE = 8.0
"""Standard deviations below the clip level from which an exposure surely isn't clipped."""

_MAY_CLIP = 5.0
"""Standard deviations from the shortest exposure's clip level within which a pixel may clip."""

_ALIKE = 1.0
"""Standard deviations below the largest difference within which another exposure may as well be the
wrong one. Chosen."""

_FALSE_ALARMS = 5e-4
"""Share of still pixels that may be taken for moved. Chosen."""


def merge(
    bracket: Bracket,
    method: Method = "full",
    defects: NDArray[np.bool_] | None = None,
    check: Callable[[float], None] = lambda share: None,
) -> RadianceEstimate:
    """Merge an exposure bracket into an HDR radiance estimate.

    Parameters
    ----------
    bracket : Bracket
        Frames with their exposure times and darks.
    method : {"full", "Granados", "Poisson", "plain"}, default "full"
        How exposures that aren't clipped are weighted. "plain": by the square of their time, as if
        all noise were the same. "Poisson": by their time, as if photons made all noise. "Granados":
        by their inverse variance, predicted from the merged value (Granados et al., CVPR 2010, doi
        10.1109/CVPR.2010.5540208). "full": likewise, and an exposure near its clip level counts by
        an estimate that is unbiased there (see `optics.hdr.near_clipping`), and what moved is left
        out.
    defects : NDArray of bool, optional
        (rows, columns): pixels that don't measure light.
    check : callable, optional
        Is called with the share that is done. It may raise, to end the work.

    Returns
    -------
    RadianceEstimate
        The variance counts photons, dark current, read noise, quantisation, and the noise of the
        dark frames, which all frames of one exposure time share.

    Raises
    ------
    ValueError
        For another method, a mask of another size, and numbers that aren't finite.
    """
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; choose one of {', '.join(METHODS)}")
    if defects is not None and defects.shape != bracket.shape:
        raise ValueError(f"defects are {defects.shape} and the frames {bracket.shape} pixels")
    rows, columns = bracket.shape
    rate, variance = (np.empty(bracket.shape, np.float32) for _ in range(2))
    state = np.empty(bracket.shape, np.uint8)
    step = max(1, _TILE // columns)
    for start in range(0, rows, step):
        check(start / rows)
        part = slice(start, start + step)
        tile = _Tile(bracket, part, method).merge()
        rate[part], variance[part], state[part] = (one.reshape(-1, columns) for one in tile)
    if defects is not None:
        state[defects], variance[defects] = DEFECTIVE, np.inf
    return RadianceEstimate(*(torch.from_numpy(one) for one in (rate, variance, state)))


class _Tile:
    """Merge some rows of a bracket to HDR radiance.

    For each exposure, the shortest first: its frames that aren't clipped are counted, and their
    electrons added.
    """

    def __init__(self, bracket: Bracket, rows: slice, method: Method) -> None:
        self._bracket, self._rows, self._method = bracket, rows, method
        self._exposures = bracket.exposures
        self._counts, self._sums = [], []
        for exposure in self._exposures:
            count: Array | None = None
            for index in exposure.frames:
                light, clipped = bracket.electrons(index, rows)
                light[clipped] = 0
                open_frames = (~clipped).astype(np.float32)
                if count is None:
                    count, total = open_frames, light
                else:
                    count, total = count + open_frames, total + light
            assert count is not None
            self._counts.append(count)
            self._sums.append(total)

    def merge(self) -> tuple[Array, Array, NDArray[np.uint8]]:
        """Return rate, variance and state of the HDR pixels."""
        rate, information = self._weighted_mean(None, self._counts)
        if self._method in ("Granados", "full"):
            for _ in range(_PASSES):
                rate, information = self._weighted_mean(rate, self._counts)
        moved = np.zeros(rate.shape, dtype=bool)
        if self._method == "full":
            rate, information, moved = self._refine(rate)
        seen = information > 0
        variance = np.where(seen, 1 / np.where(seen, information, 1), np.inf).astype(np.float32)
        if self._method in ("plain", "Poisson"):
            variance = self._variance_of_plain(rate, seen)
        rate = np.where(seen, rate, np.float32(self._clip_rate(0)))
        state = np.where(rate < 3 * np.sqrt(variance), DARK, VALID)
        state[self._away_from_clipping(0, rate) < _MAY_CLIP] = MAY_CLIP
        state[moved] = MOVED
        state[~seen] = CLIPPED
        return rate, variance, state.astype(np.uint8)

    def _clip_rate(self, number: int) -> float:
        """Return the electrons per second from which an exposure of the HDR bracket clips."""
        exposure = self._exposures[number]
        return exposure.clip_level / exposure.time

    def _away_from_clipping(self, number: int, rate: Array) -> Array:
        """Return how far predicted HDR values are below an exposure's clip level, in deviations."""
        exposure = self._exposures[number]
        level = np.float32(exposure.clip_level)
        light = rate * np.float32(exposure.time)
        return np.asarray((level - light) / np.sqrt(_frame_variance(exposure, rate)))

    def _weight(self, exposure: Exposure, rate: Array | None, count: Array) -> Array | float:
        """Return the weight of the HDR bracket's electrons in the frames of an exposure."""
        if self._method == "plain":
            return exposure.time
        if self._method == "Poisson":
            return 1.0
        # All frames of an exposure share the noise of one mean dark frame.
        variance = count * np.float32(exposure.floor / exposure.darks)
        variance += np.float32(exposure.floor) if rate is None else _frame_variance(exposure, rate)
        return np.float32(exposure.time) / variance

    def _weighted_mean(self, rate: Array | None, counts: list[Array]) -> tuple[Array, Array]:
        """Return the weighted mean of the HDR bracket's rates, and the sum of weights.

        rate: predicts the variance; None for that without light. counts: frames that count.
        """
        above, below = (np.zeros(self._counts[0].shape, np.float32) for _ in range(2))
        for exposure, count, own, total in zip(
            self._exposures, counts, self._counts, self._sums, strict=True
        ):
            weight = self._weight(exposure, rate, own)
            above += weight * (total if count is own else np.where(count > 0, total, 0))
            below += weight * count * np.float32(exposure.time)
        seen = below > 0
        mean = np.divide(above, below, out=np.zeros_like(above), where=seen)
        # Pixels that are clipped everywhere are predicted to be.
        mean[~seen] = self._clip_rate(0)
        return mean, below

    def _variance_of_plain(self, rate: Array, seen: NDArray[np.bool_]) -> Array:
        """Return the variance of an HDR rate whose weights don't follow the noise."""
        total, below = np.zeros_like(rate), np.zeros_like(rate)
        for exposure, count in zip(self._exposures, self._counts, strict=True):
            weight = self._weight(exposure, None, count)
            each = _frame_variance(exposure, rate)
            shared = np.float32(exposure.floor / exposure.darks)
            total += np.float32(weight) ** 2 * count * (each + count * shared)
            below += np.float32(weight) * count * np.float32(exposure.time)
        return np.where(seen, total / np.where(seen, below, 1) ** 2, np.inf).astype(np.float32)

    def _refine(self, rate: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return HDR rate, information and movement, by exposures that surely aren't clipped.

        Whether they are is told by the predicted value, since their own depends on chance. The
        others follow in the order of their times.
        """
        near = [np.zeros(rate.shape, dtype=bool)]
        near += [self._may_clip(number, rate) for number in range(1, len(self._exposures))]
        sure = [
            np.where(may_clip, np.float32(0), count) if may_clip.any() else count
            for count, may_clip in zip(self._counts, near, strict=True)
        ]
        known, information = self._weighted_mean(rate, sure)
        known, information, moved = self._without_outliers(known, information, sure)
        for number, exposure in enumerate(self._exposures[1:], 1):
            here = near[number] & (information > 0)
            if here.any():
                moved[here] |= self._add_near_clipping(number, here, known, information)
            moved |= ~near[number] & (self._counts[number] < len(exposure.frames))
        return known, information, moved

    def _may_clip(self, number: int, rate: Array) -> NDArray[np.bool_]:
        """Return where the HDR value doesn't surely lie below an exposure's clip level."""
        # Where the exposure is clipped, the value comes from the shorter ones, and errs as they do.
        both = math.sqrt(1 + self._shorter(number) ** 2)
        away = self._away_from_clipping(number, rate)
        return np.asarray(away <= _SAFE / 2 * (1 + both))

    def _without_outliers(
        self, rate: Array, information: Array, sure: list[Array]
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Leave the exposures out that contradict the others, pixel by pixel, the worst first."""
        moved = self._is_doubtful(rate, information, sure)
        if moved.any():
            few = copy.copy(self)
            few._counts, few._sums, kept = (
                [one[moved] for one in every] for every in (self._counts, self._sums, sure)
            )
            found = few._leave_out(rate[moved], information[moved], kept)
            rate[moved], information[moved], moved[moved] = found
        return rate, information, moved

    def _is_doubtful(self, rate: Array, information: Array, sure: list[Array]) -> NDArray[np.bool_]:
        """Return where an exposure may contradict the others; where none does, all is well."""
        doubtful = np.zeros(rate.shape, dtype=bool)
        # A little less than the limit, since a dim pixel's variance is told a little differently.
        limit = np.float32((0.9 * _outlier_limit(len(sure))) ** 2)
        for exposure, count, total in zip(self._exposures, sure, self._sums, strict=True):
            time = np.float32(exposure.time)
            weight = count * time
            weight *= self._weight(exposure, rate, count)
            residual = total - rate * (count * time)
            residual *= residual
            residual *= weight * information
            doubtful |= residual > limit * (information - weight) * (count * time) ** 2
        return doubtful & (sum((count > 0).astype(np.int8) for count in sure) > 1)

    def _leave_out(
        self, rate: Array, information: Array, sure: list[Array]
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Leave contradictory exposures out of HDR pixels; return where there were any."""
        moved, limit = np.zeros(rate.shape, dtype=bool), _outlier_limit(len(sure))
        for _ in range(len(sure) - 1):
            several = sum((count > 0).astype(np.int8) for count in sure) > 1
            differs = self._differences(rate, sure)
            worst = np.max(differs, axis=0)
            out = several & (worst > limit)
            if not out.any():
                break
            moved |= out
            # Of those that contradict each other about alike, the longest tells most and is kept.
            for number, count in enumerate(sure):
                left_out = out & (differs[number] >= worst - _ALIKE)
                sure[number] = np.where(left_out, np.float32(0), count)
                out &= ~left_out
            for _ in range(2):
                rate, information = self._weighted_mean(rate, sure)
        return rate, information, moved

    def _differences(self, rate: Array, sure: list[Array]) -> list[Array]:
        """Return how far each exposure is from the HDR value, over what chance would make of it.

        rate: predicts the variance. sure: frames of each exposure that count.
        """
        shown = np.maximum(rate, 0)
        means, variances = [], []
        for exposure, count, total in zip(self._exposures, sure, self._sums, strict=True):
            used = np.maximum(count, 1)
            means.append(total / used / np.float32(exposure.time))
            variance = _frame_variance(exposure, shown) / used
            variance += np.float32(exposure.floor / exposure.darks)
            variances.append(variance / np.float32(exposure.time**2))
        weights = [(count > 0) / variance for count, variance in zip(sure, variances, strict=True)]
        information = np.maximum(sum(weights), np.float32(1e-30))
        value = sum(w * mean for w, mean in zip(weights, means, strict=True)) / information
        found = []
        for count, mean, variance, weight in zip(sure, means, variances, weights, strict=True):
            # The value follows each exposure by its share of the information.
            own = np.maximum(1 - weight / information, np.float32(1e-6))
            differs = np.abs(mean - value) / np.sqrt(variance * own)
            found.append(np.where(count > 0, differs, np.float32(0)))
        return found

    def _add_near_clipping(
        self, number: int, near: NDArray[np.bool_], rate: Array, information: Array
    ) -> NDArray[np.bool_]:
        """Add an exposure to HDR values where it may be clipped, frame by frame.

        Returns where a frame contradicts the values of shorter exposures, and was left out.
        """
        bracket, exposure = self._bracket, self._exposures[number]
        level = exposure.clip_level
        deviation = math.sqrt(level + exposure.floor * (1 + 1 / exposure.darks))
        shorter = self._shorter(number)
        known, stated = rate[near].astype(np.float64), information[near].astype(np.float64)
        moved, limit = np.zeros(known.shape, dtype=bool), _outlier_limit(len(self._exposures))
        for index in exposure.frames:
            light, clipped = (one[near] for one in bracket.electrons(index, self._rows))
            estimate = near_clipping(shorter)
            place = (known * exposure.time - level) / deviation
            share = 1 / (1 + shorter**2)
            mean = share * place + (1 - share) * (light - level) / deviation
            away = np.where(clipped, -place, np.abs((light - level) / deviation - place))
            contradicts = away > limit * math.sqrt(1 + shorter**2)
            moved |= contradicts
            counts = ~contradicts & np.where(clipped, place < NEAR + 5 * shorter, mean < NEAR)
            value, variance = (
                np.where(clipped, one, other)
                for one, other in zip(
                    estimate.from_clipped(place), estimate.from_open(mean), strict=True
                )
            )
            known = np.where(counts, (value * deviation + level) / exposure.time, known)
            # The noise isn't quite that at the clip level.
            each = np.maximum(known, 0) * exposure.time + exposure.floor * (1 + 1 / exposure.darks)
            natural = stated + np.where(clipped, 0, exposure.time**2 / each)
            with_open = shorter / math.sqrt(1 + shorter**2)
            at_level = np.where(clipped, shorter, with_open) ** 2
            stated = np.where(counts, natural * at_level / variance, stated)
            shorter = with_open
        rate[near], information[near] = known, stated
        return moved

    def _shorter(self, number: int) -> float:
        """Return the deviation of all shorter exposures together over that of a frame.

        It is that of the HDR rate from them where the frame's exposure clips.
        """
        exposure, rate, information = self._exposures[number], self._clip_rate(number), 0.0
        for one in self._exposures[:number]:
            each = (rate * one.time + one.floor) / len(one.frames) + one.floor / one.darks
            information += one.time**2 / each
        own = rate * exposure.time + exposure.floor * (1 + 1 / exposure.darks)
        return exposure.time / math.sqrt(information * own)


def _frame_variance(exposure: Exposure, rate: Array) -> Array:
    """Return the variance of a frame of an HDR bracket where it has a rate, electrons².

    A rate may be negative by chance. Counted as 0, it would make the mean variance too large.
    """
    light = np.maximum(rate * np.float32(exposure.time), np.float32(-0.75 * exposure.floor))
    return np.asarray(light + np.float32(exposure.floor))


def _outlier_limit(exposures: int) -> float:
    """Return the deviations by which an exposure of an HDR bracket differs where things moved."""
    return float(-ndtri(_FALSE_ALARMS / 2 / max(exposures - 1, 1)))
