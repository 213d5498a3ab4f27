"""Random samples of a picture that represent all of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


def draw_samples(
    rng: np.random.Generator, light: Real, count: int
) -> tuple[NDArray[np.int64], Real]:
    """Draw samples, half by their light and half evenly; return flat indices and weights.

    Half of a sample's probability is in proportion to its light; the other half is the same for
    all. Weights are the inverse probabilities: a weighted sum over the drawn samples estimates the
    sum over all.
    light: of every sample, of any shape; not negative.
    count: samples to draw; all are taken where there are no more.
    """
    light = light.ravel()
    if light.size <= count:
        return np.arange(light.size), np.ones(light.size)
    chance = np.full(light.size, 1 / light.size)
    if light.sum() > 0:
        chance = 0.5 * chance + 0.5 * light / light.sum()
    chosen = rng.choice(light.size, count, p=chance / chance.sum())
    return chosen, 1 / chance[chosen]
