"""Find how the frames of a hand-held exposure bracket moved against each other.

Neighbours in exposure are registered to each other: the longer one's numbers are brought to the
shorter one's by their histograms, which neither the response curve nor a wrong exposure time
matters to (Grossberg and Nayar, IEEE Trans. Pattern Anal. Mach. Intell. 25, 2003, doi
10.1109/TPAMI.2003.1240119). Clipped pixels don't count.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.measuring import Registration, RigidMotion, register_pictures

Levels = NDArray[np.float32]
Mask = NDArray[np.bool_]

# Pixels at the corners (sampling allows half of one) and deviations, if moved; chosen
_NOTABLE, _SURE = 0.5, 5.0
_LEAST = 0.05  # pixels at the corners from which on aligning a frame gains; chosen
# Pixels of a frame; larger ones are averaged, and corners still known to .1 pixel; chosen
_MOST = 1_000_000
_BINS = 4  # of a histogram for each level: those of 8-bit pictures are whole; chosen


@dataclass(frozen=True, eq=False)
class FrameMotions:
    """How frames moved against the one that most of the others stand still with.

    motions: from the reference to each frame. deviations: standard deviations at the corners,
    pixels; infinite, with no motion, for frames that share too little detail with the others.
    """

    reference: int
    motions: tuple[RigidMotion, ...]
    deviations: tuple[float, ...]
    shape: tuple[int, int]

    @property
    def distances(self) -> list[float]:
        """Return how far each frame moved at the corners, pixels."""
        return [one.corner_distance(RigidMotion(), self.shape) for one in self.motions]

    @property
    def moved(self) -> list[int]:
        """Return the indices of frames that surely moved."""
        return self._farther_than(_NOTABLE)

    @property
    def shifted(self) -> list[int]:
        """Return the indices of frames that gain by being aligned, even if they moved little."""
        return self._farther_than(_LEAST)

    def _farther_than(self, least: float) -> list[int]:
        pairs = enumerate(zip(self.distances, self.deviations, strict=True))
        return [k for k, (far, deviation) in pairs if far > max(least, _SURE * deviation)]

    @property
    def lost(self) -> list[int]:
        """Return the indices of frames whose motion isn't known where most of the others moved."""
        unknown = [k for k, one in enumerate(self.deviations) if math.isinf(one)]
        others = len(self.motions) - len(unknown) - 1
        return unknown if 2 * len(self.moved) > others > 0 else []


def find_motions(
    frames: Iterable[tuple[Sequence[NDArray[Any]], Sequence[Mask]]],
    period: int = 1,
) -> FrameMotions:
    """Find how the frames of a hand-held bracket moved against each other.

    Parameters
    ----------
    frames : iterable of (bands, clipped)
        Bands of each frame, (rows, columns), from 0 to 255, of like noise everywhere: numbers of
        8-bit pictures, or the square root of light; and where they are clipped. Large ones are
        averaged down as they come, so that an iterator needs little memory.
    period : int, default 1
        Pixels after which the sensor's colour filters repeat, along both axes: so many are
        averaged, since filters stay where they are, whatever moves.

    Returns
    -------
    FrameMotions
    """
    levels, clipped, shape, side = [], [], (0, 0), 1
    for bands, masks in frames:
        shape = (int(bands[0].shape[0]), int(bands[0].shape[1]))
        side = period * math.ceil(math.sqrt(math.prod(shape) / _MOST) / period)
        levels.append([_averaged(band, side) for band in bands])
        clipped.append([_averaged(mask, side) > 0 for mask in masks])
    order = np.argsort([np.mean([band.mean() for band in one]) for one in levels], kind="stable")
    # Motions against the darkest frame, by neighbours in brightness.
    chain, links = [RigidMotion()], [0.0]
    for darker, brighter in itertools.pairwise(order):
        found = _register_pair(levels[darker], levels[brighter], clipped[darker], clipped[brighter])
        chain.append(found.motion.inverse().after(chain[-1]))
        links.append(found.deviation)
    best, spread = _reference(chain, links, levels[0][0].shape)
    # Of frames that were averaged down, the middle of what was averaged, from that of the frame.
    middle = np.array([(n // side * side - n) / 2 for n in shape])
    motions, deviations = [RigidMotion()] * len(chain), [math.inf] * len(chain)
    back = chain[best].inverse()
    for place, number in enumerate(order):
        if math.isfinite(spread[place]):
            one = chain[place].after(back)
            if side > 1:
                shift = side * one.shift + middle - one.matrix @ middle
                one = RigidMotion(one.turn, float(shift[0]), float(shift[1]))
            motions[number], deviations[number] = one, side * float(spread[place])
    return FrameMotions(int(order[best]), tuple(motions), tuple(deviations), shape)


def _averaged(band: NDArray[Any], side: int) -> NDArray[np.float32]:
    """Return a band with the means of side x side pixels."""
    if side == 1:
        return band.astype(np.float32)
    rows, columns = (n // side for n in band.shape)
    parts = band[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return np.asarray(parts.mean(axis=(1, 3), dtype=np.float32))


def _register_pair(
    darker: Sequence[Levels],
    brighter: Sequence[Levels],
    darker_clipped: Sequence[Mask],
    brighter_clipped: Sequence[Mask],
) -> Registration:
    """Return how the darker of two frames moved against the brighter one."""
    # Numbers of 0 are clipped, too, or those of a border that was filled.
    valid = [~one & (levels > 0) for one, levels in zip(brighter_clipped, brighter, strict=True)]
    fixed, moving = [], []
    for bright, dark, mask in zip(brighter, darker, valid, strict=True):
        brought = _with_histogram_of(bright, dark)
        # What is clipped in the brighter frame is so in both.
        top = brought[mask].max(initial=0)
        fixed.append(np.minimum(brought, top))
        moving.append(np.minimum(dark, top))
    return register_pictures(fixed, moving, valid, [~one for one in darker_clipped])


def _with_histogram_of(levels: Levels, other: Levels) -> Levels:
    """Exchange a frame's levels for those that as many pixels of another have."""
    count = 256 * _BINS
    place, others = (np.clip(one * _BINS, 0, count - 1).astype(np.intp) for one in (levels, other))
    own, theirs = (np.bincount(one.ravel(), minlength=count) for one in (place, others))
    # The mean of their levels between the ranks of each level's first and last pixel.
    ranks = np.concatenate([[0], np.cumsum(own)])
    value = (np.arange(count) + 0.5) / _BINS
    theirs_ranks = np.concatenate([[0], np.cumsum(theirs)])
    theirs_sums = np.concatenate([[0], np.cumsum(theirs * value)])
    sums = np.interp(ranks, theirs_ranks, theirs_sums)
    seen = own > 0
    table = np.interp(value, value[seen], np.diff(sums)[seen] / own[seen])
    return np.asarray(table[place], dtype=np.float32)


def _reference(
    chain: Sequence[RigidMotion], links: Sequence[float], shape: tuple[int, ...]
) -> tuple[int, NDArray[np.float64]]:
    """Return the place in a chain that most others stand still with, and the others' deviations.

    links: standard deviations of each against the one before. Deviations are infinite where a link
    is.
    """
    count = len(chain)
    away, spread = np.zeros((count, count)), np.full((count, count), math.inf)
    for one, other in np.ndindex(count, count):
        away[one, other] = chain[one].corner_distance(chain[other], shape)
        low, high = sorted((one, other))
        if all(math.isfinite(link) for link in links[low + 1 : high + 1]):
            spread[one, other] = math.sqrt(sum(link**2 for link in links[low + 1 : high + 1]))
    linked = np.isfinite(spread)
    still = linked & (away <= _NOTABLE)
    # Of frames with as many still ones, and as many linked ones, the best known is the reference.
    known = -np.where(linked, spread, 0.0).sum(axis=1)
    best = int(np.lexsort((known, linked.sum(axis=1), still.sum(axis=1)))[-1])
    return best, spread[best]
