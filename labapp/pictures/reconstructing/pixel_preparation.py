"""Prepare pixels for a decoder: one band, averaged squares, and no gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from labapp.common.errors import UserError
from labapp.files.picture.photograph import Light

_SIGMA = 1.0
"""Standard deviation in pixels of the Gaussian by which neighbours count where a pixel is filled.
Chosen: the nearest neighbours have most of the weight."""

_LEAST_WEIGHT = 1e-3
"""Share of the Gaussian's weight on sound pixels below which the nearest sound one is taken.
Chosen: that happens in the middle of gaps of more than six pixels."""


def merge_bands(light: Light, *, grey: bool, source: str) -> Light:
    """Return the bands as one, (1, rows, columns): bands that are equal, or their mean.

    Raises UserError for different bands unless the person says that the light is grey.
    """
    if len(light) == 1 or all(np.array_equal(light[0], one, equal_nan=True) for one in light):
        return light[:1]
    if not grey:
        raise UserError(
            f"{source}: has {len(light)} different bands, and a decoder is for light of one "
            "wavelength, at which its PSFs are known. Add --grey to decode the mean of the bands, "
            "which is right for light of that colour."
        )
    merged: Light = light.mean(0, keepdims=True)
    return merged


def average_squares(light: Light, side: int) -> Light:
    """Average pixels in squares; NaN counts as missing, and stays where all is.

    light: (bands, rows, columns). What is left over at the far edges is dropped.
    """
    if side == 1:
        return light
    bands, rows, columns = light.shape
    if min(rows, columns) < side:
        raise UserError(
            f"the photograph has {rows} x {columns} pixels, and the decoder averages {side} x "
            f"{side} of them. Give a larger one."
        )
    cut = light[:, : rows // side * side, : columns // side * side]
    squares = cut.reshape(bands, rows // side, side, columns // side, side)
    sound = np.isfinite(squares)
    counts = sound.sum((2, 4))
    sums = np.where(sound, squares, 0).sum((2, 4), dtype=np.float64)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan).astype(np.float32)


def fill_gaps(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Fill missing pixels (NaN) from their neighbours; sound pixels are unchanged.

    A missing pixel gets the mean of the sound ones around it, weighted by a Gaussian; in the middle
    of large gaps, the nearest sound one. UserError if no pixel is sound.

    light: (rows, columns), as is the result, float32.
    """
    sound = np.isfinite(light)
    if sound.all():
        return light
    if not sound.any():
        raise UserError("the photograph has no sound pixel. Give another.")
    known = np.where(sound, light, 0).astype(np.float64)
    weights = gaussian_filter(sound.astype(np.float64), _SIGMA)
    means = gaussian_filter(known, _SIGMA) / np.maximum(weights, _LEAST_WEIGHT)
    nearest = known[
        tuple(distance_transform_edt(~sound, return_distances=False, return_indices=True))
    ]
    filled = np.where(weights > _LEAST_WEIGHT, means, nearest)
    return np.where(sound, light, filled).astype(np.float32)
