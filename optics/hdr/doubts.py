"""Find the few pixels of a bracket that a mean isn't right for, and settle them together.

These are pixels near an exposure's clip level, and those in which exposures contradict each other.
Whether an exposure may be clipped is told by the mean, since its own value depends on chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optics.hdr.clip_levels import ClipLevel, add_near_clipping
from optics.hdr.contradictions import leave_out, may_contradict
from optics.hdr.samples import Array, Indices, Mask, Samples, join_samples
from optics.hdr.weighted_mean import WeightedMean, mean_and_contradiction


@dataclass(frozen=True, eq=False)
class Doubts:
    """Pixels of a bracket for which its mean may be wrong.

    indices: where they are. sure: their samples, without exposures that may be clipped. near: for
    each exposure but the shortest, indices of those in which it tells something of light near its
    clip level. moved: indices of those in which an exposure is clipped that can't be.
    """

    indices: Indices
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
    few = np.flatnonzero(
        may_contradict(contradiction, len(levels)) | _near_clipping(samples, mean.rate, levels)
    )
    part, rate = samples.part(few), mean.rate[few]
    may_clip, near, moved = np.zeros((3, *part.rates.shape), dtype=bool)
    for number, level in enumerate(levels[1:], 1):
        time = part.times[number]
        may_clip[number] = rate >= level.lowest
        near[number] = may_clip[number] & ((time > 0) | (rate < level.highest))
        moved[number] = ~(may_clip[number] | _all_open(level, time))
    indices = first + few
    return Doubts(
        indices,
        part.without(may_clip),
        [indices[one] for one in near[1:]],
        indices[moved.any(axis=0)],
    )


def _near_clipping(samples: Samples, rate: Array, levels: list[ClipLevel]) -> Mask:
    """Return where an exposure of the bracket may clip, and isn't sure to; or clips, and can't."""
    found = np.zeros(rate.shape, dtype=bool)
    for level, time in zip(levels[1:], samples.times[1:], strict=True):
        may_clip = rate >= level.lowest
        found |= may_clip == _all_open(level, time)
        found |= may_clip & (rate < level.highest)
        if len(level.exposure.frames) > 1:
            found |= may_clip & (time > 0)
    return found


def _all_open(level: ClipLevel, time: Array) -> Mask:
    """Return where no frame of a bracket's exposure is clipped; time: that of its open frames."""
    return time > (len(level.exposure.frames) - 0.5) * level.exposure.time


def join_doubts(found: list[Doubts]) -> Doubts:
    """Return the doubtful pixels of several parts of a bracket as those of one."""
    return Doubts(
        np.concatenate([one.indices for one in found]),
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
    moved = [doubts.moved, _merge_sure(doubts, mean)]
    for level, near in zip(levels[1:], doubts.near, strict=True):
        seen = near[mean.information[near] > 0]
        if seen.size:
            moved.append(seen[add_near_clipping(level, rows, seen, mean)])
    return np.concatenate(moved)


def _merge_sure(doubts: Doubts, mean: WeightedMean) -> Indices:
    """Merge doubtful pixels of a bracket again, in place, by what is sure and doesn't contradict.

    Returns those in which exposures were left out.
    """
    if not doubts.indices.size:
        return doubts.indices
    again, contradiction = mean_and_contradiction(doubts.sure, mean.rate[doubts.indices])
    few = np.flatnonzero(may_contradict(contradiction, len(doubts.sure.exposures)))
    found, out = leave_out(doubts.sure.part(few), WeightedMean(*(one[few] for one in again)))
    for whole, one, better in zip(mean, again, found, strict=True):
        one[few] = better
        whole[doubts.indices] = one
    return doubts.indices[few[out]]
