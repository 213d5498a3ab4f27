"""The digital numbers of a picture along a straight line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from optics.validation import require_unmasked

Place = tuple[float, float]
"""Row and column in pixels; whole numbers are the centres of pixels."""


@dataclass(frozen=True, eq=False)
class LineProfile:
    """Numbers along a line of a picture.

    Parameters
    ----------
    distances : NDArray of float64, (n,)
        Pixels from the line's start.
    values : NDArray of float64, (n,)
        Digital numbers, interpolated bilinearly.
    """

    distances: NDArray[np.float64]
    values: NDArray[np.float64]


def line_profile(numbers: NDArray[Any], start: Place, end: Place) -> LineProfile:
    """Return the digital numbers along a line, at steps of a pixel or a little less.

    Between pixels they are interpolated bilinearly, so that no number is larger or smaller than
    those around it.

    Parameters
    ----------
    numbers : NDArray, (rows, columns)
        Digital numbers.
    start, end : (float, float)
        Rows and columns of both ends, within the picture.

    Returns
    -------
    LineProfile
        With both ends; of a line without length, one number.

    Raises
    ------
    ValueError
        For an end outside the picture.
    """
    require_unmasked(numbers)
    for name, place in (("start", start), ("end", end)):
        inside = all(0 <= c <= n - 1 for c, n in zip(place, numbers.shape, strict=True))
        if not inside:
            raise ValueError(
                f"{name} is row {place[0]:g}, column {place[1]:g}; the picture has "
                f"{numbers.shape[0]} x {numbers.shape[1]} pixels, counted from 0"
            )
    length = math.dist(start, end)
    share = np.linspace(0.0, 1.0, math.ceil(length) + 1)
    places = [first + share * (last - first) for first, last in zip(start, end, strict=True)]
    values = ndimage.map_coordinates(numbers, places, np.float64, order=1, mode="nearest")
    return LineProfile(share * length, values)
