"""Turn a camera's channels into linear sRGB by the matrix that its RAW files state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SRGB_TO_XYZ = np.array(
    [
        [0.4124, 0.3576, 0.1805],
        [0.2126, 0.7152, 0.0722],
        [0.0193, 0.1192, 0.9505],
    ]
)
"""From linear sRGB to CIE XYZ, whose sums over rows are D65 (IEC 61966-2-1)."""

_MOST_AMPLIFICATION = 100.0
"""Ratio of the largest to the least colour difference that a camera's channels may show. Chosen:
published cameras have 2 to 10, and beyond 100 a colour would be a guess."""


def camera_to_linear_srgb(matrix: NDArray[np.floating]) -> NDArray[np.float64]:
    """Compute the matrix from a camera's white-balanced channels to linear sRGB, (3, channels).

    White stays white: the channels of linear sRGB's white are scaled to 1, as they are after the
    white balance. With more than three channels, sRGB is the least-squares fit. ValueError if the
    matrix can't be turned round: a channel sees no light, or channels see alike. Adobe, Digital
    Negative Specification 1.7.1, chapter 6; IEC 61966-2-1 (sRGB).

    matrix: (channels, 3), from CIE XYZ to three channels or more, for D65 or the light that is
        nearest to it, as the tag ColorMatrix of a DNG has it.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[1] != 3 or len(matrix) < 3:
        raise ValueError(f"matrix is {matrix.shape}; give (channels, 3), of three or more channels")
    seen = matrix @ SRGB_TO_XYZ
    white = seen.sum(1, keepdims=True)
    if not (np.isfinite(white).all() and (white > 0).all()):
        raise ValueError("matrix has a channel in which white gives nothing; give the camera's")
    balanced = seen / white
    if np.linalg.cond(balanced) > _MOST_AMPLIFICATION:
        raise ValueError("matrix has channels that see colours alike; give the camera's")
    return np.linalg.pinv(balanced)


def daylight_white(matrix: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return what D65, sRGB's white, gives in each channel of a camera, on any scale.

    `matrix` is (channels, 3), from XYZ.
    """
    white: NDArray[np.float64] = np.asarray(matrix, dtype=np.float64) @ SRGB_TO_XYZ.sum(1)
    return white
