"""Draw random samples of a picture that represent all of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


def draw_samples(
    rng: np.random.Generator, light: Real, count: int
) -> tuple[NDArray[np.int64], Real]:
    """Draw the samples on which `labapp accuracy` compares methods: half by light, half evenly.

    Half of a sample's probability is in proportion to its light; the other half is the same for
    all.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of random numbers.
    light : Real
        Light of every sample, of any shape; not negative.
    count : int
        Samples to draw; all are taken where there are no more.

    Returns
    -------
    tuple
        Indices in the flattened picture, and weights, which are the inverse probabilities: a
        weighted sum over the drawn samples estimates the sum over all.
    """
    light = light.ravel()
    if light.size <= count:
        return np.arange(light.size), np.ones(light.size)
    chance = np.full(light.size, 1 / light.size)
    if light.sum() > 0:
        chance = 0.5 * chance + 0.5 * light / light.sum()
    chosen = rng.choice(light.size, count, p=chance / chance.sum())
    return chosen, 1 / chance[chosen]
