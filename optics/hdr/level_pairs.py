"""Compare the numbers of two 8-bit frames of a bracket where they are calm and not clipped.

The number that a frame has where another has a given one is what tells response curve and exposure
ratio (Grossberg and Nayar's comparametric function, IEEE Trans. Pattern Anal. Mach. Intell. 25,
2003, doi 10.1109/TPAMI.2003.1240119). Medians of small even patches know little of noise,
compression and what moves.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optics.hdr.response_curve import HIGHEST
from optics.measuring import RigidMotion

Array = NDArray[np.float64]

_SIDE = 4
"""Side of a patch in pixels. Chosen: its mean has a fourth of the noise, and few have edges."""

_PATCHES = 100_000
"""Patches of a frame, at most, evenly over it. Chosen."""

_BORDER = 8
"""Pixels at the border in which no patch lies. Chosen: scans have rims."""

_LEAST, _LEAST_MEAN = 2, 12.0
"""Least number of a patch's pixels, and of their mean: below, numbers are cut or rounded too
coarsely. Chosen."""

_CALM = (5.0, 8.0, 12.0, 20.0)
"""Deviations within a patch up to which it is calm: the first that leaves enough patches. Chosen.
"""

_ENOUGH, _TOO_FEW = 600, 40
"""Patches that are enough, and too few. Chosen."""

_STEPS, _IN_STEP = 60, 20
"""Steps along the two frames' numbers in each of which a median is taken, at most, and patches in a
step, at least. Chosen."""

_WIDEST = 30.0
"""Range of the sum of both numbers within a step, at most. Chosen: curves are straight in it."""

_ROUNDING = 0.06
"""Deviation of a median that rounding leaves, numbers. Chosen."""

_ALIKE, _APART = 4.0, 10.0
"""Difference of numbers up to which both may be the darkness or the white of a film, which tells no
light, where other numbers differ by more than the second one. Chosen."""


class Patches(NamedTuple):
    """Means and deviations of the numbers of small patches of a frame, and which ones count."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    counts: NDArray[np.bool_]


def frame_patches(numbers: NDArray[Any], motion: RigidMotion) -> Patches:
    """Return the patches of a frame's band, at places of the reference, to the nearest pixel.

    numbers: (rows, columns). motion: of the frame.
    """
    middle = (np.array(numbers.shape)[:, None] - 1) / 2
    step = max(_SIDE, round(math.sqrt(numbers.size / _PATCHES)))
    inside = [
        np.arange(_BORDER, max(n - _BORDER - _SIDE, _BORDER + 1), step) for n in numbers.shape
    ]
    corner = np.array([one.ravel() for one in np.meshgrid(*inside, indexing="ij")])
    half = (_SIDE - 1) / 2
    at = np.rint(motion.places(corner + half - middle) + middle - half).astype(np.intp)
    last = np.array(numbers.shape)[:, None] - _SIDE
    seen = ((at >= 0) & (at <= last)).all(axis=0)
    row, column = np.clip(at, 0, last)
    every = np.stack(
        [numbers[row + down, column + right] for down in range(_SIDE) for right in range(_SIDE)]
    ).astype(np.float32)
    counts = seen & (every.max(axis=0) <= HIGHEST) & (every.min(axis=0) >= _LEAST)
    mean = every.mean(axis=0)
    return Patches(mean, every.std(axis=0), counts & (mean >= _LEAST_MEAN))


def compare_levels(first: Patches, second: Patches) -> Array:
    """Return numbers that two frames of a bracket have at the same places, (3, steps).

    The rows are the numbers of the first and of the second frame, and the standard deviation of
    their difference; there are no columns if too few patches are seen well in both.
    """
    both, deviation = first.counts & second.counts, np.maximum(first.deviation, second.deviation)
    for limit in _CALM:
        used = both & (deviation < limit)
        if used.sum() >= _ENOUGH:
            break
    if used.sum() < _TOO_FEW:
        return np.zeros((3, 0))
    total = (first.mean + second.mean)[used].astype(np.float64)
    away = (second.mean - first.mean)[used].astype(np.float64)
    order = np.argsort(total)
    each = max(_IN_STEP, len(order) // _STEPS)
    found = []
    for start in range(0, len(order) - each + 1, each):
        few = order[start : start + each]
        if np.ptp(total[few]) > _WIDEST:
            continue
        middle, whole = np.median(away[few]), np.median(total[few])
        spread = 1.4826 * np.median(np.abs(away[few] - middle))
        # A median's deviation is 1.25 times a mean's.
        known = np.hypot(1.25 * spread / np.sqrt(each), _ROUNDING)
        found.append(((whole - middle) / 2, (whole + middle) / 2, known))
    pairs = np.array(found).reshape(-1, 3).T
    differ = np.abs(pairs[1] - pairs[0])
    if differ.max(initial=0) > _APART:
        pairs = pairs[:, differ > _ALIKE]
    return pairs
