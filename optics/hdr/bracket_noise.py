"""Estimate a sensor's gain and read noise from the frames of an exposure bracket themselves.

Two frames of one scene, the longer one scaled to the shorter one's time, differ by noise alone. Its
variance by the light is a straight line, as in photon transfer (Janesick, "Photon Transfer", SPIE
2007, doi 10.1117/3.725073): the slope tells the gain, the start the read noise. Texture drops out;
what moved is passed over by robust deviations.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_PIXELS = 400_000
"""Pixels that are looked at, evenly over the frames. Chosen: the gain is right to a percent."""

_BINS, _LEAST_IN_BIN = 40, 200
"""Ranges of light in each of which a variance is taken, and pixels in it, at least. Chosen."""

_MOVED = 4.5
"""Robust deviations beyond which something moved in a pixel. Chosen: chance hardly reaches it."""

_LEAST_BINS = 6
"""Ranges of light that tell a straight line. Chosen."""

_BELOW_FULL = 0.9
"""Part of the full scale up to which numbers count: noise is cut near clipping. Chosen."""

_ROUNDING = 1 / 12
"""Variance of rounding, digital numbers squared."""


@dataclass(frozen=True)
class BracketNoise:
    """Noise of a sensor, as the frames of a bracket show it.

    gain: electrons per digital number. read_noise: electrons. gain_deviation: relative standard
    deviation of the gain.
    """

    gain: float
    read_noise: float
    gain_deviation: float


def estimate_bracket_noise(
    frames: Sequence[NDArray[Any]], exposures: ArrayLike, black: NDArray[Any] | float, white: float
) -> BracketNoise:
    """Estimate gain and read noise from the frames of an exposure bracket.

    Parameters
    ----------
    frames : sequence of NDArray
        Each (rows, columns), digital numbers, of a scene that stands still.
    exposures : array_like
        Seconds, one for each frame; only their order counts.
    black : NDArray or float
        Digital number of no light, (rows, columns) or one for all.
    white : float
        Digital number from which pixels are clipped.

    Returns
    -------
    BracketNoise

    Raises
    ------
    ValueError
        If two frames share too few ranges of light, or their noise doesn't grow with the light.
    """
    order = np.argsort(np.asarray(exposures, dtype=np.float64), kind="stable")
    size = np.asarray(frames[0]).size
    every = slice(None, None, max(1, size // _PIXELS))
    dark = np.broadcast_to(np.asarray(black, dtype=np.float64), np.shape(frames[0])).ravel()[every]
    lights = [np.asarray(frames[k], dtype=np.float64).ravel()[every] - dark for k in order]
    limit = _BELOW_FULL * (white - dark)
    rows = [
        _variances(one, other, (one < limit) & (other < limit))
        for one, other in itertools.pairwise(lights)
    ]
    joined = np.concatenate([np.zeros((4, 0)), *rows], axis=1)
    if joined.shape[1] < _LEAST_BINS:
        raise ValueError(
            "no two frames show enough light of different strength that isn't clipped: they don't "
            "tell the noise. Add an exposure between them"
        )
    return _line(*joined)


def _variances(one: Array, other: Array, used: NDArray[np.bool_]) -> Array:
    """Return what a pair of a bracket's frames tells of noise, (4, ranges of light).

    The rows are factors of one over the gain and of the variance without light, the variance of
    the frames' difference, and its relative deviation.
    """
    one, other = one[used], other[used]
    bright = one + other > np.quantile(one + other, 0.5) if one.size else used[used]
    if bright.sum() < _LEAST_IN_BIN:
        return np.zeros((4, 0))
    ratio = float(other[bright].sum() / one[bright].sum())
    away, light = one - other / ratio, (one + other) / (1 + ratio)
    # The light's order is taken from both frames, as its own noise would choose.
    order = np.argsort(light)
    found = []
    for part in np.array_split(order, max(1, min(_BINS, len(order) // _LEAST_IN_BIN))):
        middle = np.median(away[part])
        spread = 1.4826 * np.median(np.abs(away[part] - middle))
        still = np.abs(away[part] - middle) <= _MOVED * spread
        mean = max(float(light[part][still].mean()), 0.0)
        variance, known = float(away[part][still].var()), math.sqrt(2 / len(part))
        found.append((mean * (1 + 1 / ratio), 1 + 1 / ratio**2, variance, known))
    return np.array(found).T


def _line(light: Array, number: Array, variance: Array, known: Array) -> BracketNoise:
    """Return the bracket's noise by the line through variances of the frames' differences."""
    weight = 1 / (known * np.maximum(variance, 1e-6))
    design = np.stack([light, number], axis=1)
    for _ in range(3):
        (slope, dark), _ = scipy.optimize.nnls(design * weight[:, None], variance * weight)
        expected = np.maximum(design @ np.array([slope, dark]), 1e-6)
        weight = 1 / (known * expected)
    if slope <= 0:
        raise ValueError(
            "the noise of the frames doesn't grow with the light, as photons' does: numbers were "
            "smoothed, or aren't proportional to light"
        )
    gain = 1 / slope
    information = (design * weight[:, None]).T @ (design * weight[:, None])
    deviation = math.sqrt(float(np.linalg.pinv(information)[0, 0])) / slope
    return BracketNoise(gain, gain * math.sqrt(max(dark - _ROUNDING, 0.0)), deviation)
