"""Tell a lamp that flickers from a camera that isn't linear, by repeated frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.camera_noise.few_exposures import FewExposures
from optics.camera_noise.measured import Measured

Array = NDArray[np.float64]

_SIGMAS = 4.0
"""Deviations by which frames must differ beyond their noise for the lamp to flicker. Chosen."""


@dataclass(frozen=True)
class RepeatedLinearity:
    """How a camera's numbers rise with the exposure, in the mean of repeated frames.

    exponent: power of the exposure, 1 if it is linear; its deviation holds the lamp's. flicker:
    deviation of the light from frame to frame of one exposure, relative, 0 where noise explains it.
    """

    exponent: Measured
    flicker: float


def repeated_linearity(
    exposures: Sequence[float], repeats: Sequence[Sequence[NDArray[np.generic]]]
) -> RepeatedLinearity | None:
    """Return a camera's linearity by several frames of each of three exposures; None if it is dark.

    A lamp that flickers gives each frame another light. Its mean stays, and how much the result
    depends on single frames tells how well it is known (the jackknife of Quenouille and Tukey).
    """
    frames = [np.asarray(group, dtype=np.float64) for group in repeats]
    count = min(len(group) for group in frames)
    means = [group.mean(axis=0) for group in frames]
    seen = _exponent(exposures, means)
    if seen is None or count < 3:
        return None
    left = []
    for number in range(count):
        found = _exponent(exposures, [np.delete(one, number, 0).mean(axis=0) for one in frames])
        if found is None:
            return None
        left.append(found.value)
    scatter = (count - 1) / count * float(np.sum((np.array(left) - np.mean(left)) ** 2))
    black = FewExposures(exposures, means).black_level.value
    flicker = max(frame_flicker(group, black) for group in frames)
    return RepeatedLinearity(Measured(seen.value, math.hypot(seen.sigma, scatter**0.5)), flicker)


def _exponent(exposures: Sequence[float], means: Sequence[Array]) -> Measured | None:
    found = FewExposures(exposures, means).linearity
    return None if found is None else found.exponent


def frame_flicker(images: Sequence[NDArray[np.generic]] | Array, black: float) -> float:
    """Return how much the light of a camera's frames of one exposure differs, relative.

    black: level of darkness in DN. The result is 0 where noise explains the difference.
    """
    frames = np.asarray(images, dtype=np.float64)
    mean = frames.mean(axis=0)
    bright = mean - black > (float(np.quantile(mean, 0.999)) - black) / 2
    if not bright.any() or (light := float(mean[bright].mean()) - black) <= 0:
        return 0.0
    levels = frames[:, bright].mean(axis=1)
    # What all pixels have in common isn't their noise.
    alone = frames[:, bright] - levels[:, None]
    noise = float(alone.std(axis=0, ddof=1).mean()) / math.sqrt(bright.sum())
    deviation = float(levels.std(ddof=1))
    return deviation / light if deviation > _SIGMAS * noise else 0.0
