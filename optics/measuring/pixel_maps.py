"""Means of a group of pixels over all frames, and the defective ones among them.

Hot ones are told by dark signal and by response, and dead ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from optics.measuring.paired_frames import Pairs

Map = NDArray[np.float64]
Halves = tuple[Map, Map]
Mask = NDArray[np.bool_]

# Pixels: side of the box whose mean is the light around a pixel, vignetting included; chosen
_BOX = 15
BOX_SHARE = 1 - 1 / _BOX**2  # of the response's variance that is left without slow changes


@dataclass(frozen=True, eq=False)
class GroupMaps:
    """Maps of a group of pixels, (rows, columns) each.

    dark: halves of the mean dark number at the exposure times of the light, DN.
    current: growth of the dark number with the exposure time, DN/s.
    response: halves of each pixel's light over the group's mean; None where no exposure is bright
        and unclipped.
    """

    dark: Halves
    current: Map
    response: Halves | None


def average_frames(
    frames: NDArray[Any], light: Pairs, dark: Pairs, bright: list[float]
) -> GroupMaps:
    """Average all frames of a group of pixels, (frames, rows, columns).

    bright: exposure times whose light is clear of darkness and of clipping.
    """
    longest = max(light)
    short = [pair for time, pairs in dark.items() if time <= longest for pair in pairs]
    response: Halves | None = None
    if bright:
        lit = _half_means(frames, [pair for time in bright for pair in light[time]])
        # Darks of the same exposure times, so that a hot pixel's own current is taken off.
        base = _half_means(frames, [pair for time in bright for pair in dark[time]])
        first, second = lit[0] - base[0], lit[1] - base[1]
        response = first / first.mean(), second / second.mean()
    # The slope of each pixel over the exposure time of its dark frames.
    listed = [(time, index) for time, pairs in dark.items() for pair in pairs for index in pair]
    middle = float(np.mean([time for time, _ in listed]))
    growth = np.zeros(frames.shape[1:])
    for time, index in listed:
        growth += (time - middle) * frames[index]
    growth = growth / sum((time - middle) ** 2 for time, _ in listed)
    return GroupMaps(_half_means(frames, short), growth, response)


def _half_means(frames: NDArray[Any], pairs: list[tuple[int, int]]) -> Halves:
    """Return the means of the first and of the second frames of pairs."""
    totals = np.zeros(frames.shape[1:]), np.zeros(frames.shape[1:])
    for pair in pairs:
        for total, index in zip(totals, pair, strict=True):
            total += frames[index]
    return totals[0] / len(pairs), totals[1] / len(pairs)


def _local_mean(response: Map, good: Mask) -> Map:
    """Return the mean response of the good pixels around each pixel.

    A paraboloid over all of them is taken off first, so that the border is as good as the middle.
    """
    y, x = (np.linspace(-1, 1, n) for n in response.shape)
    terms = (np.ones((1, 1)), y[:, None], x, y[:, None] ** 2, y[:, None] * x, x**2)
    design = np.stack([np.broadcast_to(term, response.shape) for term in terms], axis=-1)
    own = design[good]
    weights = np.linalg.solve(own.T @ own + 1e-9 * np.eye(6), own.T @ response[good])
    slow = np.maximum(design @ weights, 0.1 * float(response[good].mean()))
    shares = uniform_filter(good.astype(np.float64), _BOX, mode="reflect")
    total = uniform_filter(np.where(good, response / slow, 0.0), _BOX, mode="reflect")
    # Where all pixels around are defective, the paraboloid is all that is known of the light.
    known = shares > 0.5 / _BOX**2
    return slow * np.where(known, total / np.where(known, shares, 1.0), 1.0)


def without_slow_changes(response: Map, good: Mask) -> Map:
    """Return the response over that of the surroundings, less 1, and 0 at defects."""
    return np.where(good, response / np.where(good, _local_mean(response, good), 1.0) - 1, 0.0)


Indices = NDArray[np.int64]

DARK_DEVIATIONS = 6.0
"""Robust standard deviations beyond which a pixel's dark signal or dark current is a defect.
Chosen: of ten million normal pixels, none is beyond."""

RESPONSE_EXCESS = 0.2
"""Relative deviation of a pixel's response from its surroundings, beyond which it is a defect.
Chosen: more than dust and PRNU do."""

DEAD_RESPONSE = 0.5
"""Response, relative to the surroundings, below which a pixel is dead. Chosen."""

_MAD = 1.4826  # standard deviation over the median absolute deviation of a normal distribution
_ROUNDING = 0.3  # DN: least spread of dark numbers, that of rounding


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
        """All defective pixels, each once."""
        return np.unique(np.concatenate([self.hot, self.bright, self.weak, self.dead]), axis=0)

    def mask(self, shape: tuple[int, int]) -> Mask:
        """Return a mask of (rows, columns), true at defective pixels."""
        found = np.zeros(shape, dtype=bool)
        found[tuple(self.every.T)] = True
        return found


@dataclass(frozen=True, eq=False)
class GroupDefects:
    """Masks of defective pixels in a group, with the limits of Defects."""

    hot: Mask
    bright: Mask
    weak: Mask
    dead: Mask
    dark_limit: float
    current_limit: float

    @property
    def good(self) -> Mask:
        """Pixels without a defect."""
        return ~(self.hot | self.bright | self.weak | self.dead)


def find_defects(maps: GroupMaps, longest: float) -> GroupDefects:
    """Find the defective pixels in a group.

    longest: exposure time in seconds of the longest dark frame.
    """
    dark, dark_limit = _deviations((maps.dark[0] + maps.dark[1]) / 2, _ROUNDING)
    current, current_limit = _deviations(maps.current, _ROUNDING / longest)
    hot = (np.abs(dark) > dark_limit) | (current > current_limit)
    if maps.response is None:
        none = np.zeros_like(hot)
        return GroupDefects(hot, none, none, none, dark_limit, current_limit)
    response = (maps.response[0] + maps.response[1]) / 2
    # Extreme pixels don't spoil the mean of their surroundings.
    tame = np.abs(response / np.median(response) - 1) < DEAD_RESPONSE
    for _ in range(2):
        around = response / _local_mean(response, tame)
        tame = np.abs(around - 1) < RESPONSE_EXCESS
    dead, bright = around < DEAD_RESPONSE, around > 1 + RESPONSE_EXCESS
    weak = (around < 1 - RESPONSE_EXCESS) & ~dead
    return GroupDefects(hot, bright & ~hot, weak & ~hot, dead, dark_limit, current_limit)


def _deviations(values: Map, least: float) -> tuple[Map, float]:
    """Return deviations from the median, and the limit of those without a defect."""
    away = values - np.median(values)
    return away, DARK_DEVIATIONS * max(_MAD * float(np.median(np.abs(away))), least)


def collect_defects(found: Sequence[tuple[GroupDefects, Indices, Indices]]) -> Defects:
    """Join the defects of all groups, each with its rows and columns."""

    def indices_of(kind: str) -> Indices:
        parts = [np.stack([rows, columns])[:, getattr(one, kind)] for one, rows, columns in found]
        row, column = np.concatenate(parts, axis=1)
        order = np.lexsort((column, row))
        return np.stack([row[order], column[order]], axis=1).astype(np.int64)

    limits = np.median([(one.dark_limit, one.current_limit) for one, _, _ in found], axis=0)
    hot, bright, weak, dead = map(indices_of, ("hot", "bright", "weak", "dead"))
    return Defects(hot, bright, weak, dead, float(limits[0]), float(limits[1]))
