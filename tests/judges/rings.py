"""Rings with a central peak, integrated over pixels on a fine grid, and frames of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

Array = NDArray[np.float64]

_FINER = 8
"""Points of the fine grid in a pixel, along each axis."""


def ring_psf(
    radius: float,
    zeroth_order: float,
    centre: Sequence[float] = (0.0, 0.0),
    *,
    reach: int,
    width: float = 0.6,
) -> Array:
    """A ring of a Gaussian profile and a peak of the same, 2 reach + 1 pixels square.

    radius, width (standard deviation) and centre (y, x) are in pixels; the sum is 1.
    """
    side = 2 * reach + 1
    fine = (np.arange(side * _FINER) + 0.5) / _FINER - 0.5 - reach
    distance = np.hypot(fine[:, None] - centre[0], fine - centre[1])
    ring = np.exp(-((distance - radius) ** 2) / (2 * width**2))
    peak = np.exp(-(distance**2) / (2 * width**2))
    parts = [
        one.reshape(side, _FINER, side, _FINER).sum((1, 3)) / one.sum() for one in (ring, peak)
    ]
    return (1 - zeroth_order) * parts[0] + zeroth_order * parts[1]


def bayer_frame(bands: Array, response: Array) -> Array:
    """What an RGGB mosaic sees of bands, (bands, rows, columns); response: (3, bands)."""
    letters = np.array([[0, 1], [1, 2]])
    frame = np.zeros(bands.shape[1:])
    for y, x in np.ndindex(2, 2):
        frame[y::2, x::2] = np.einsum("b,byx->yx", response[letters[y, x]], bands[:, y::2, x::2])
    return frame


def blurred_part(scene: Array, psfs: Array, corner: Sequence[int], shape: Sequence[int]) -> Array:
    """A part of a scene's bands after blur, with the light of what lies around it.

    Where the scene ends, its mirror image goes on.
    """
    reach = psfs.shape[-1] // 2
    rows, columns = (
        slice(first, first + n + 2 * reach) for first, n in zip(corner, shape, strict=True)
    )
    around = [np.pad(band, reach, mode="reflect")[rows, columns] for band in scene]
    blurred = [fftconvolve(band, psf, "valid") for band, psf in zip(around, psfs, strict=True)]
    return np.stack(blurred)


def vary_response(response: Array, spread: float, rng: np.random.Generator) -> Array:
    """The response with a relative error of each entry; each band keeps its sum."""
    varied = response * np.exp(spread * rng.standard_normal(response.shape))
    return varied * (response.sum(0) / varied.sum(0))


def direction(rng: np.random.Generator) -> tuple[float, float]:
    """A random unit vector (y, x)."""
    angle = rng.uniform(0, 2 * math.pi)
    return math.sin(angle), math.cos(angle)
