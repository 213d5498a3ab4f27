"""Merge the frames of an exposure bracket into radiance with variance and state.

The few pixels that a mean isn't right for are settled together. Last, the time that this takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed
from optics.hdr.bracket import Bracket
from optics.hdr.clip_levels import ClipLevel, add_near_clipping
from optics.hdr.weighted_mean import (
    METHODS,
    Array,
    Indices,
    Method,
    Samples,
    WeightedMean,
    information_by_time,
    join_samples,
    leave_out,
    may_contradict,
    mean_and_contradiction,
    mean_by_time,
    mean_by_variance,
    read_samples,
)


class PixelState(IntEnum):
    """What is known of a merged pixel.

    VALID pixels are measured. CLIPPED pixels are clipped in every exposure, so that the value is
    a lower bound. DARK pixels are below three standard deviations of their noise, so that three
    standard deviations are an upper bound. MAY_CLIP pixels lie within five standard deviations of
    the clip level of the shortest exposure: whether that clipped decides their value, which is
    biased. MOVED pixels contradict themselves, and exposures were left out. DEFECTIVE pixels were
    named as such, and aren't measured.
    """

    VALID = 0
    CLIPPED = 1
    DARK = 2
    MAY_CLIP = 3
    MOVED = 4
    DEFECTIVE = 5


VALID, CLIPPED, DARK, MAY_CLIP, MOVED, DEFECTIVE = PixelState


class RadianceEstimate(NamedTuple):
    """Radiance of a scene, one value per pixel.

    rate: electrons per second, float32. variance: that of the rate, float32; infinite where
    nothing is measured. state: numbers of `PixelState`, uint8.
    """

    rate: torch.Tensor
    variance: torch.Tensor
    state: torch.Tensor


@dataclass(frozen=True, eq=False)
class _Doubts:
    """Pixels for which a weighted mean may be wrong.

    indices: where they are. sure: their samples, without exposures that may be clipped. near: for
    each exposure but the shortest, indices of those in which it tells something of light near its
    clip level. moved: indices of those in which an exposure is clipped that can't be.
    """

    indices: Indices
    sure: Samples
    near: list[Indices]
    moved: Indices


def _find_doubts(
    samples: Samples,
    mean: WeightedMean,
    contradiction: Array,
    levels: list[ClipLevel],
    first: int,
) -> _Doubts:
    """Return the pixels for which the mean may be wrong.

    contradiction: chi squared of the mean. first: index of the samples' first pixel.
    """
    doubtful = may_contradict(contradiction, len(levels))
    for level, time in zip(levels[1:], samples.times[1:], strict=True):
        # A frame may clip, and isn't sure to; or clips, and can't.
        may_clip = mean.rate >= level.lowest
        doubtful |= may_clip == level.all_open(time)
        doubtful |= may_clip & (mean.rate < level.highest)
        if len(level.exposure.frames) > 1:
            doubtful |= may_clip & (time > 0)
    few = np.flatnonzero(doubtful)
    part, rate = samples.part(few), mean.rate[few]
    may_clip, near, moved = np.zeros((3, *part.rates.shape), dtype=bool)
    for number, level in enumerate(levels[1:], 1):
        time = part.times[number]
        may_clip[number] = rate >= level.lowest
        near[number] = may_clip[number] & ((time > 0) | (rate < level.highest))
        moved[number] = ~(may_clip[number] | level.all_open(time))
    indices = first + few
    sure = part.without(may_clip)
    return _Doubts(indices, sure, [indices[one] for one in near[1:]], indices[moved.any(axis=0)])


def _settle_doubts(
    parts: list[_Doubts], mean: WeightedMean, levels: list[ClipLevel], rows: slice
) -> Indices:
    """Merge doubtful pixels of all parts again, in place; return those in which something moved.

    First by what is sure and doesn't contradict; exposures that may be clipped follow in the order
    of their times. rows: of the frames that the mean is of.
    """
    moved = [one.moved for one in parts]
    indices = np.concatenate([one.indices for one in parts])
    sure = join_samples([one.sure for one in parts])
    if indices.size:
        again, contradiction = mean_and_contradiction(sure, mean.rate[indices])
        few = np.flatnonzero(may_contradict(contradiction, len(levels)))
        found, out = leave_out(sure.part(few), WeightedMean(*(one[few] for one in again)))
        for whole, one, better in zip(mean, again, found, strict=True):
            one[few] = better
            whole[indices] = one
        moved.append(indices[few[out]])
    for level, each in zip(levels[1:], zip(*(one.near for one in parts), strict=True), strict=True):
        near = np.concatenate(each)
        seen = near[mean.information[near] > 0]
        if seen.size:
            moved.append(seen[add_near_clipping(level, rows, seen, mean)])
    return np.concatenate(moved)


# Pixels that are averaged together, in a core's memory: 2¹⁴ to 2¹⁶ take the same time
_TILE = 1 << 15
# Pixels whose doubtful ones are settled together: enough for each call of numpy; chosen
_BLOCK = 1 << 19
_DARK = 3.0  # standard deviations of its noise below which a pixel counts as dark


def merge(
    bracket: Bracket,
    method: Method = "full",
    defects: NDArray[np.bool_] | None = None,
    check: Callable[[float], None] = lambda share: None,
) -> RadianceEstimate:
    """Merge an exposure bracket into an estimate of the scene's radiance.

    Parameters
    ----------
    bracket : Bracket
        Frames with their exposure times and darks.
    method : {"full", "Granados", "Poisson", "plain"}, default "full"
        How exposures that aren't clipped are weighted. "plain": by the square of their time, as if
        all noise were the same. "Poisson": by their time, as if photons made all noise. "Granados":
        by their inverse variance, predicted from the merged value (Granados et al., CVPR 2010, doi
        10.1109/CVPR.2010.5540208). "full": likewise, and an exposure near its clip level counts by
        an estimate that is unbiased there (see `optics.hdr.clip_levels`), and what moved is left
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
    rate, variance = np.empty((2, *bracket.shape), np.float32)
    state = np.empty(bracket.shape, np.uint8)
    levels = [ClipLevel(bracket, number) for number in range(len(bracket.exposures))]
    step = max(1, _BLOCK // columns)
    for start in range(0, rows, step):
        check(start / rows)
        part = slice(start, min(start + step, rows))
        mean = WeightedMean(rate[part].ravel(), variance[part].ravel())
        moved = _merge_rows(bracket, part, method, levels, mean)
        state[part] = _states(mean, levels[0].may_clip, moved).reshape(-1, columns)
        with np.errstate(divide="ignore"):
            np.divide(1, mean.information, out=mean.information)
    if defects is not None:
        state[defects], variance[defects] = DEFECTIVE, np.inf
    return RadianceEstimate(*(torch.from_numpy(one) for one in (rate, variance, state)))


def _merge_rows(
    bracket: Bracket, rows: slice, method: Method, levels: list[ClipLevel], mean: WeightedMean
) -> Indices:
    """Write the mean of the pixels in some rows; return where something is known to have moved.

    mean: is overwritten.
    """
    columns = bracket.shape[1]
    count, step = rows.stop - rows.start, max(1, _TILE // columns)
    space = np.empty((4, len(bracket.exposures), step * columns), dtype=np.float32)
    doubts = []
    for start in range(0, count, step):
        stop = min(start + step, count)
        samples = read_samples(bracket, slice(rows.start + start, rows.start + stop), space)
        here = slice(start * columns, stop * columns)
        tile, contradiction = _mean(samples, method)
        mean.rate[here], mean.information[here] = tile
        if contradiction is not None:
            doubts.append(_find_doubts(samples, tile, contradiction, levels, here.start))
    return _settle_doubts(doubts, mean, levels, rows) if doubts else np.array([], np.intp)


def _mean(samples: Samples, method: Method) -> tuple[WeightedMean, Array | None]:
    """Return the mean by a method and, for "full", how much frames contradict each other."""
    if method in ("plain", "Poisson"):
        rate = mean_by_time(samples, method)
        return WeightedMean(rate, information_by_time(samples, rate, method)), None
    # After one pass, weights would depend on the chance that is in the longest exposures; a third
    # one changed nothing in brackets of two to eight exposures.
    first = mean_by_variance(samples, mean_by_time(samples)).rate
    if method == "full":
        return mean_and_contradiction(samples, first)
    return mean_by_variance(samples, first), None


def _states(mean: WeightedMean, may_clip: np.float32, moved: Indices) -> NDArray[np.uint8]:
    """Return the states of pixels; moved: indices of those that contradict themselves."""
    state = np.full(mean.rate.shape, int(VALID), dtype=np.uint8)
    significance = np.abs(mean.rate)
    significance *= mean.rate
    significance *= mean.information
    state[significance < _DARK**2] = DARK
    state[mean.rate > may_clip] = MAY_CLIP
    state[moved] = MOVED
    state[~(mean.information > 0)] = CLIPPED
    return state


# Passes over a pixel that any merge takes, in units of `MachineSpeed.touch`. Measured on brackets
# of two to eight frames.
_PIXEL_TOUCHES = 32.0

# Passes for each frame, by method. Measured likewise.
_FRAME_TOUCHES = MappingProxyType({"plain": 3.0, "Poisson": 3.0, "Granados": 4.5, "full": 12.0})

# Time to find an exposure's estimate near its clip level, in units of `MachineSpeed.call`; for
# all but the shortest, in the method "full". Measured.
_CLIPPING_CALLS = 100.0


def merge_seconds(bracket: Bracket, method: Method, speed: MachineSpeed) -> float:
    """Predict the processor time that merging takes, seconds.

    Parameters
    ----------
    bracket : Bracket
        Its size and exposures count.
    method : str
        How exposures are weighted.
    speed : MachineSpeed
        Of the machine at hand.
    """
    pixels = math.prod(bracket.shape)
    touches = pixels * (_PIXEL_TOUCHES + _FRAME_TOUCHES[method] * len(bracket.times))
    calls = _CLIPPING_CALLS * (len(bracket.exposures) - 1) if method == "full" else 1.0
    return touches * speed.touch + calls * speed.call


def choose_method(
    bracket: Bracket, budget: float, speed: MachineSpeed | None = None, bands: int = 1
) -> Method:
    """Choose the best way to merge that fits a time.

    Parameters
    ----------
    bracket : Bracket
        To be merged.
    budget : float
        Processor seconds, positive.
    speed : MachineSpeed, optional
        Of the machine at hand; by default that of a server.
    bands : int, default 1
        Number of such brackets that the budget is for.

    Returns
    -------
    str
        The last of `METHODS` that fits.

    Raises
    ------
    ValueError
        For a budget that isn't positive, or in which no method fits; the message names the least
        one that would do.
    """
    if not 0 < budget < math.inf:
        raise ValueError(f"budget is {budget:g} s; give a positive number of seconds")
    speed = speed or MachineSpeed()
    seconds = {one: bands * merge_seconds(bracket, one, speed) for one in METHODS}
    fitting = [one for one in METHODS if seconds[one] <= budget]
    if not fitting:
        least = min(seconds, key=seconds.__getitem__)
        raise ValueError(
            f"budget is {budget:g} s; merging takes {seconds[least]:.2g} s at least, by the method "
            f"{least}"
        )
    return fitting[-1]
