"""Find a camera's defective pixels: hot ones by dark signal and by response, and dead ones.

A pixel's dark signal is compared with the spread of all of them, because that is what a camera's
pixels are like. Its response is compared with that of the pixels around it, because light is never
quite even.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.camera_noise.pixel_maps import GroupMaps, Map, Mask, local_mean

Indices = NDArray[np.int64]

DARK_DEVIATIONS = 6.0
"""Robust standard deviations beyond which a pixel's dark signal or dark current is a defect.
Chosen: of ten million normal pixels, none is beyond."""

RESPONSE_EXCESS = 0.2
"""Relative deviation of a pixel's response from its surroundings, beyond which it is a defect.
Chosen: more than dust and PRNU do."""

DEAD_RESPONSE = 0.5
"""Response, relative to the surroundings, below which a pixel is dead. Chosen."""

_MAD = 1.4826
"""Standard deviation over the median absolute deviation of a normal distribution."""

_ROUNDING = 0.3
"""Least spread of dark numbers, DN: that of rounding."""


@dataclass(frozen=True, eq=False)
class Defects:
    """Defective pixels of a camera, as (row, column), (n, 2) each.

    Parameters
    ----------
    hot : NDArray of int
        By dark signal: number or growth with time is beyond DARK_DEVIATIONS.
    bright : NDArray of int
        By photo-response: more than RESPONSE_EXCESS above the surroundings.
    weak : NDArray of int
        By photo-response: as much below, but not dead.
    dead : NDArray of int
        Of less than DEAD_RESPONSE of the response around them.
    dark_limit, current_limit : float
        Deviations from the median beyond which dark number (DN) and growth (DN/s) are defects.
    """

    hot: Indices
    bright: Indices
    weak: Indices
    dead: Indices
    dark_limit: float
    current_limit: float

    @property
    def every(self) -> Indices:
        """All defective pixels of the camera, each once."""
        return np.unique(np.concatenate([self.hot, self.bright, self.weak, self.dead]), axis=0)

    def mask(self, shape: tuple[int, int]) -> Mask:
        """Return a mask of the camera's (rows, columns), true at defective pixels."""
        found = np.zeros(shape, dtype=bool)
        found[tuple(self.every.T)] = True
        return found


@dataclass(frozen=True, eq=False)
class GroupDefects:
    """Masks of defective pixels in a group of the camera's pixels, with the limits of Defects."""

    hot: Mask
    bright: Mask
    weak: Mask
    dead: Mask
    dark_limit: float
    current_limit: float

    @property
    def good(self) -> Mask:
        """Mask of the camera's pixels without a defect."""
        return ~(self.hot | self.bright | self.weak | self.dead)


def find_defects(maps: GroupMaps, longest: float) -> GroupDefects:
    """Find the defective pixels in a group of a camera's pixels.

    longest: exposure time in seconds of the longest dark frame.
    """
    dark, dark_limit = _deviations(maps.mean_dark, _ROUNDING)
    current, current_limit = _deviations(maps.current, _ROUNDING / longest)
    hot = (np.abs(dark) > dark_limit) | (current > current_limit)
    none = np.zeros_like(hot)
    if maps.response is None:
        return GroupDefects(hot, none, none, none, dark_limit, current_limit)
    response = (maps.response[0] + maps.response[1]) / 2
    # Extreme pixels don't spoil the mean of their surroundings.
    tame = np.abs(response / np.median(response) - 1) < DEAD_RESPONSE
    for _ in range(2):
        around = response / local_mean(response, tame)
        tame = np.abs(around - 1) < RESPONSE_EXCESS
    dead, bright = around < DEAD_RESPONSE, around > 1 + RESPONSE_EXCESS
    weak = (around < 1 - RESPONSE_EXCESS) & ~dead
    return GroupDefects(hot, bright & ~hot, weak & ~hot, dead, dark_limit, current_limit)


def _deviations(values: Map, least: float) -> tuple[Map, float]:
    """Return a camera's deviations from the median, and the limit of those without a defect."""
    away = values - np.median(values)
    return away, DARK_DEVIATIONS * max(_MAD * float(np.median(np.abs(away))), least)


def collect_defects(found: Sequence[tuple[GroupDefects, Indices, Indices]]) -> Defects:
    """Collect the defects of all groups of a camera's pixels, each with its rows and columns."""

    def indices_of(kind: str) -> Indices:
        parts = [
            np.stack([rows[mask], columns[mask]], axis=1)
            for one, rows, columns in found
            if (mask := getattr(one, kind)).any()
        ]
        empty = np.zeros((0, 2), dtype=np.int64)
        every = np.concatenate([empty, *parts]).astype(np.int64)
        return every[np.lexsort((every[:, 1], every[:, 0]))]

    def limit(name: str) -> float:
        return float(np.median([getattr(one, name) for one, _, _ in found]))

    return Defects(
        indices_of("hot"), indices_of("bright"), indices_of("weak"), indices_of("dead"),
        limit("dark_limit"), limit("current_limit"),
    )  # fmt: skip
