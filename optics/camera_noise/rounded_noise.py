"""Compute the noise of a converter's input from its numbers, where it is less than a step.

Rounding adds a twelfth of a squared step to noise of more than half a step (Sheppard). Less noise
shows only where a pixel lies near the edge of a step, which depends on what the pixels read. Here
pixels read a normal distribution of levels, and noise is found that explains all three numbers that
are measured: the mean, the variance over pixels, and the temporal variance.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares
from scipy.special import ndtr

Array = NDArray[np.float64]

STEP_VARIANCE = 1 / 12
"""Variance that rounding adds to noise of more than half a step, in steps²."""

SURE_VARIANCE = 0.36
"""Variance of a noise, in steps², for which the twelfth is right to 1 %: at .6 steps, the largest
error is 4 exp(-2π² · .36) of it."""

_NODES = 2001
"""Levels between -6 and 6 standard deviations over which pixels are summed."""

_LEAST = 1e-3
"""Least noise that is looked for, in steps."""


def rounded_moments(level: Array, noise: float) -> tuple[Array, Array]:
    """Compute mean and variance of a camera's noisy levels after rounding, in steps."""
    centre = np.round(level)
    reach = math.ceil(6 * noise) + 1
    mean, square = np.zeros_like(level), np.zeros_like(level)
    for step in range(-reach, reach + 1):
        low, high = (centre + step + side - level for side in (-0.5, 0.5))
        share = ndtr(high / noise) - ndtr(low / noise)
        mean += step * share
        square += step**2 * share
    return centre + mean, square - mean**2


def temporal_variance(mean: float, spread: float, noise: float) -> float:
    """Compute the mean temporal variance of a camera's pixels after rounding, in steps².

    mean, spread: of the normal distribution of the pixels' levels. noise: of each, in steps.
    """
    if spread < _LEAST:
        return float(rounded_moments(np.array([mean]), noise)[1][0])
    places = np.linspace(-6, 6, _NODES)
    shares = np.exp(-(places**2) / 2)
    variances = rounded_moments(mean + spread * places, noise)[1]
    return float((shares * variances).sum() / shares.sum())


def noise_below_a_step(mean: float, over_pixels: float, temporal: float) -> float:
    """Find the noise of a camera before rounding, in steps.

    mean, over_pixels: mean and variance of all numbers of a frame. temporal: mean temporal variance
    of the pixels. The larger of two values is given where both explain it.
    """

    def misfit(parameters: Array) -> Array:
        level, width = parameters
        found = rounded_moments(np.array([level]), width)
        return np.array([found[0][0] - mean, found[1][0] - over_pixels])

    start = [mean, math.sqrt(max(over_pixels - STEP_VARIANCE, 0.05))]
    fitted = least_squares(misfit, start, bounds=([mean - 1, _LEAST], [mean + 1, np.inf]))
    level, width = fitted.x

    def excess(noise: float) -> float:
        return temporal_variance(level, math.sqrt(max(width**2 - noise**2, 0.0)), noise) - temporal

    # Never more than the noise and the pixels' spread together.
    if excess(width) <= 0:
        return float(width)
    if excess(_LEAST) >= 0:
        return _LEAST
    return float(brentq(excess, _LEAST, width, xtol=1e-5))
