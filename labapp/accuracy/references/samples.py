"""Samples of a picture that stand for all of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


def draw_samples(
    rng: np.random.Generator, light: Real, count: int
) -> tuple[NDArray[np.int64], Real]:
    """Draw samples half by their light and half evenly.

    Parameters
    ----------
    light
        Of every sample, of any shape; not negative.
    count
        Samples that are wanted; all are taken where there are no more.

    Returns
    -------
    tuple
        Their numbers in the flattened picture, and one over the chance of each: sums over the
        drawn, weighed by these, estimate sums over all.
    """
    light = light.ravel()
    if light.size <= count:
        return np.arange(light.size), np.ones(light.size)
    chance = np.full(light.size, 1 / light.size)
    if light.sum() > 0:
        chance = 0.5 * chance + 0.5 * light / light.sum()
    chosen = rng.choice(light.size, count, p=chance / chance.sum())
    return chosen, 1 / chance[chosen]
