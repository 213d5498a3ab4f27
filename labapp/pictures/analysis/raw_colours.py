"""The colour filters of a RAW photograph, with gains and matrix by what its file says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.raw import RawPhotograph
from labapp.pictures.analysis.colour_filters import ColourFilters

_SRGB_TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""From linear sRGB to CIE XYZ, whose sums over rows are D65 (IEC 61966-2-1)."""

_MOST_AMPLIFICATION = 100.0
"""Ratio of the largest to the least colour difference that a camera's channels may show. Chosen:
published cameras have 2 to 10, and beyond 100 a colour would be a guess."""


def raw_filters(raw: RawPhotograph, *, is_grey: bool = False) -> tuple[ColourFilters, list[str]]:
    """Return a RAW photograph's colour filters, and remarks on its white and its matrix.

    White is as the camera found it; where the file doesn't say, as daylight (D65) gives it by the
    camera's matrix, or else equal in all channels. Raises UserError for filters other than red,
    green and blue without a matrix to colours.

    is_grey: whether the scene is taken for one band.
    """
    assert raw.pattern is not None
    gains, notes = _gains(raw)
    matrix = None
    if not is_grey:
        matrix, said = _matrix_to_srgb(raw)
        notes += said
    return ColourFilters(raw.pattern, raw.channels, gains, matrix, None, is_grey), notes


def _gains(raw: RawPhotograph) -> tuple[NDArray[np.float64], list[str]]:
    """Return the light of white in each channel, largest 1, with remarks."""
    colour = raw.colour
    if colour.white is not None:
        return colour.white / colour.white.max(), []
    daylight = None
    if colour.matrix is not None:
        daylight = np.asarray(colour.matrix, dtype=np.float64) @ _SRGB_TO_XYZ.sum(1)
    if daylight is not None and daylight.min() > 0:
        return daylight / daylight.max(), [
            "the file has no white balance: white is taken as daylight (D65) gives it"
        ]
    return np.ones(len(raw.channels)), [
        f"the file has no white balance: white is taken to be equal in {', '.join(raw.channels)}"
    ]


def _matrix_to_srgb(raw: RawPhotograph) -> tuple[NDArray[np.float64], list[str]]:
    """Return the matrix from white-balanced channels to linear sRGB, with remarks."""
    matrix = raw.colour.matrix
    try:
        if matrix is not None:
            return _camera_to_linear_srgb(matrix), []
        reason = "the file has no colour matrix of its camera"
    except ValueError as error:
        reason = f"the file's colour matrix can't be used ({error})"
    if raw.channels != "RGB":
        raise UserError(
            f"{raw.path}: has filters {', '.join(raw.channels)}, and {reason}, so that its colours "
            "aren't known. Restore it as one grey band: --grey."
        )
    return np.eye(3), [f"{reason}: its red, green and blue are shown as sRGB's"]


def _camera_to_linear_srgb(matrix: NDArray[np.floating]) -> NDArray[np.float64]:
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
    seen = matrix @ _SRGB_TO_XYZ
    white = seen.sum(1, keepdims=True)
    if not (np.isfinite(white).all() and (white > 0).all()):
        raise ValueError("matrix has a channel in which white gives nothing; give the camera's")
    balanced = seen / white
    if np.linalg.cond(balanced) > _MOST_AMPLIFICATION:
        raise ValueError("matrix has channels that see colours alike; give the camera's")
    return np.linalg.pinv(balanced)
