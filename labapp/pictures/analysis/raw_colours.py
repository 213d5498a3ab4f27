"""The colour filters of a RAW photograph, with gains and matrix by what its file says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.raw import RawPhotograph
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.camera_colours import camera_to_linear_srgb, daylight_white


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
    if colour.matrix is not None and (white := daylight_white(colour.matrix)).min() > 0:
        return white / white.max(), [
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
            return camera_to_linear_srgb(matrix), []
        reason = "the file has no colour matrix of its camera"
    except ValueError as error:
        reason = f"the file's colour matrix can't be used ({error})"
    if raw.channels != "RGB":
        raise UserError(
            f"{raw.path}: has filters {', '.join(raw.channels)}, and {reason}, so that its colours "
            "aren't known. Restore it as one grey band: --grey."
        )
    return np.eye(3), [f"{reason}: its red, green and blue are shown as sRGB's"]
