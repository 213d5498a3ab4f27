"""Find the few pixels of a bracket that a mean isn't right for, and settle them together.

These are pixels near an exposure's clip level, and those in which exposures contradict each other.
Whether an exposure may be clipped is told by the mean, since its own value depends on chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.hdr.clip_levels import ClipLevel, add_near_clipping
from optics.hdr.contradictions import leave_out, may_contradict
from optics.hdr.samples import Array, Mask, Samples, join_samples
from optics.hdr.weighted_mean import WeightedMean, mean_and_contradiction

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Doubts:
    """Indices of pixels of a bracket for which its mean may be wrong.

    unsure: in which an open exposure may be clipped, or exposures may contradict each other. sure:
    their samples, without exposures that may be clipped. near: for each exposure but the shortest,
    pixels in which it tells something of light near its clip level. moved: in which an exposure is
    clipped that can't be.
    """

    unsure: Indices
    sure: Samples
    near: list[Indices]
    moved: Indices


def find_doubts(
    samples: Samples,
    mean: WeightedMean,
    contradiction: Array,
    levels: list[ClipLevel],
    first: int,
) -> Doubts:
    """Return the pixels of a bracket for which the mean may be wrong; first: index of their first.

    contradiction: chi squared of the mean.
    """
    doubtful = may_contradict(contradiction, len(levels))
    for level, time in zip(levels[1:], samples.times[1:], strict=True):
        may_clip = mean.rate >= level.lowest
        # Nothing is in doubt where it can't clip and doesn't, or clips for sure.
        doubtful |= may_clip == _all_open(level, time)
        doubtful |= may_clip & (mean.rate < level.highest)
        if len(level.exposure.frames) > 1:
            doubtful |= may_clip & (time > 0)
    few = np.flatnonzero(doubtful)
    return _sort_doubts(samples.part(few), mean.rate[few], contradiction[few], levels, first + few)


def _sort_doubts(
    few: Samples, rate: Array, contradiction: Array, levels: list[ClipLevel], indices: Indices
) -> Doubts:
    """Return doubtful pixels of a bracket by the reason for doubts; indices: where they are."""
    unsure = may_contradict(contradiction, len(levels))
    moved = np.zeros(unsure.shape, dtype=bool)
    close, near = [moved], []
    for level, time in zip(levels[1:], few.times[1:], strict=True):
        may_clip, is_open = rate >= level.lowest, time > 0
        unsure |= may_clip & is_open
        moved = moved | ~(may_clip | _all_open(level, time))
        near.append(indices[may_clip & (is_open | (rate < level.highest))])
        close.append(may_clip)
    places = np.flatnonzero(unsure)
    sure = few.part(places).without([one[places] for one in close])
    return Doubts(indices[unsure], sure, near, indices[moved])


def _all_open(level: ClipLevel, time: Array) -> Mask:
    """Return where no frame of a bracket's exposure is clipped; time: that of its open frames."""
    return time > (len(level.exposure.frames) - 0.5) * level.exposure.time


def join_doubts(found: list[Doubts]) -> Doubts:
    """Return the doubtful pixels of several parts of a bracket as those of one."""
    return Doubts(
        np.concatenate([one.unsure for one in found]),
        join_samples([one.sure for one in found]),
        [np.concatenate(every) for every in zip(*(one.near for one in found), strict=True)],
        np.concatenate([one.moved for one in found]),
    )


def settle_doubts(
    doubts: Doubts, mean: WeightedMean, levels: list[ClipLevel], rows: slice
) -> Indices:
    """Merge doubtful pixels of a bracket again, in place; return those in which something moved.

    rows: of the frames that the mean is of. Exposures that may be clipped follow in the order of
    their times.
    """
    moved = [doubts.moved, _merge_unsure(doubts, mean)]
    for level, near in zip(levels[1:], doubts.near, strict=True):
        seen = near[mean.information[near] > 0]
        if seen.size:
            moved.append(seen[add_near_clipping(level, rows, seen, mean)])
    return np.concatenate(moved)


def _merge_unsure(doubts: Doubts, mean: WeightedMean) -> Indices:
    """Merge unsure pixels of a bracket again, in place, by exposures that don't contradict."""
    if not doubts.unsure.size:
        return doubts.unsure
    again, contradiction = mean_and_contradiction(doubts.sure, mean.rate[doubts.unsure])
    few = np.flatnonzero(may_contradict(contradiction, len(doubts.sure.exposures)))
    part = WeightedMean(*(one[few] for one in again))
    found, out = leave_out(doubts.sure.part(few), part)
    for whole, one, better in zip(mean, again, found, strict=True):
        one[few] = better
        whole[doubts.unsure] = one
    return doubts.unsure[few[out]]
