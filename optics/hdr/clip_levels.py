"""Count an exposure where its pixels may be clipped, by the value that shorter exposures give."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from optics.hdr.bracket import Bracket, Exposure
from optics.hdr.contradictions import outlier_limit
from optics.hdr.near_clipping import NEAR, near_clipping
from optics.hdr.samples import Mask
from optics.hdr.weighted_mean import WeightedMean

_SAFE = 8.0
"""Standard deviations below the clip level from which an exposure surely isn't clipped."""

_MAY_CLIP = 5.0
"""Standard deviations from the shortest exposure's clip level within which a pixel may clip."""


@dataclass(frozen=True)
class ClipLevel:
    """The clip level of an exposure, and what all shorter ones know of light there.

    number: of the exposure in the bracket, 0 for the shortest.
    """

    bracket: Bracket
    number: int

    @property
    def exposure(self) -> Exposure:
        """The HDR bracket's exposure whose clip level it is."""
        return self.bracket.exposures[self.number]

    @cached_property
    def shorter(self) -> float:
        """Deviation of all shorter exposures of the bracket together, over that of a frame.

        It is that of the rate from them where the frame's exposure clips.
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
        """Standard deviation of a frame of the bracket at the clip level, electrons."""
        exposure = self.exposure
        return math.sqrt(exposure.clip_level + exposure.floor * (1 + 1 / exposure.darks))

    @cached_property
    def lowest(self) -> np.float32:
        """Rate from which an exposure of the bracket doesn't surely lie below its clip level."""
        # Where the exposure is clipped, the value comes from the shorter ones, and errs as they do.
        return self._rate_below(_SAFE / 2 * (1 + math.sqrt(1 + self.shorter**2)))

    @cached_property
    def highest(self) -> np.float32:
        """Rate from which a clipped exposure tells an HDR bracket nothing that wasn't known."""
        light = self.exposure.clip_level + self.deviation * (NEAR + 5 * self.shorter)
        return np.float32(light / self.exposure.time)

    @property
    def may_clip(self) -> np.float32:
        """Rate from which chance may clip the bracket's exposure."""
        return self._rate_below(_MAY_CLIP)

    def _rate_below(self, away: float) -> np.float32:
        """Return the rate whose light is some of its own deviations below the clip level."""
        level, floor = self.exposure.clip_level, self.exposure.floor
        # light + away · √(light + floor) = level
        light = level + away**2 / 2 - away * math.sqrt(away**2 / 4 + level + floor)
        return np.float32(light / self.exposure.time)


def add_near_clipping(
    level: ClipLevel, rows: slice, near: NDArray[np.intp], mean: WeightedMean
) -> Mask:
    """Add an exposure to HDR values where it may be clipped, frame by frame, in place.

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
