"""Measure the temporal noise of a pair of frames, without fixed patterns and changes of the light.

EMVA 1288 takes half the variance of a pair's difference, in which what is fixed cancels. A lamp
that changes between the two frames leaves a part of the picture in the difference. So the frames
are scaled to each other first, and the mean of each block of the difference is taken off: what
changes over many pixels is the light's, not the camera's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Frame = NDArray[Any]
Mask = NDArray[np.bool_]

_BLOCK = 16
"""Side in pixels of the blocks over which the light's change counts as even. Chosen."""

_SURE_SIGNAL = 100.0
"""Signal over the noise of its mean from which frames are scaled to each other: dimmer ones tell
nothing of the lamp. Chosen."""


@dataclass(frozen=True)
class PairNoise:
    """Mean and temporal noise of two frames of the same exposure time.

    mean: of both, DN. variance: temporal, of a frame, DN². spread: variance of a squared difference
    over the square of its mean, 2 for normal noise on evenly lit pixels. count: independent squared
    differences. ratio: light of the second frame over that of the first.
    """

    mean: float
    variance: float
    spread: float
    count: int
    ratio: float = 1.0


def measure_pair(first: Frame, second: Frame, good: Mask, dark: float | None = None) -> PairNoise:
    """Measure mean and temporal noise of a camera's pair of frames, on its good pixels.

    `dark` is the mean number without light; None for frames that are dark themselves. The estimate
    of the variance is unbiased for any light, even or not, that keeps its shape.
    """
    a, b = first.astype(np.float64), second.astype(np.float64)
    count = int(good.sum())
    means = float(a[good].mean()), float(b[good].mean())
    ratio = 1.0
    if dark is not None:
        signals = means[0] - dark, means[1] - dark
        chance = float(np.std((a - b)[good])) / math.sqrt(count)
        if min(signals) > _SURE_SIGNAL * chance:
            ratio = signals[1] / signals[0]
            # Half the difference's variance stays K times the mean signal of both.
            root = math.sqrt(ratio)
            a, b = (a - dark) * root, (b - dark) / root
    left, freedom = _without_blocks(a - b, good)
    squares = left[good] ** 2
    mean_square = float(squares.mean())
    spread = float((squares**2).mean()) / mean_square**2 - 1 if mean_square else 2.0
    variance = float(squares.sum()) / max(freedom, 1) / 2
    return PairNoise(sum(means) / 2, variance, max(spread, 0.0), max(freedom, 1), ratio)


def _without_blocks(difference: NDArray[np.float64], good: Mask) -> tuple[Frame, int]:
    """Return a pair's difference less the mean of each block, and the degrees of freedom."""
    starts = [np.arange(0, n, _BLOCK) for n in difference.shape]
    sums, counts = (
        np.add.reduceat(np.add.reduceat(one, starts[0], axis=0), starts[1], axis=1)
        for one in (np.where(good, difference, 0.0), good.astype(np.int64))
    )
    means = sums / np.maximum(counts, 1)
    for axis, n in enumerate(difference.shape):
        means = means.repeat(np.diff(np.append(starts[axis], n)), axis=axis)
    return difference - means, int(np.maximum(counts - 1, 0).sum())
