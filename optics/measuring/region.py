"""The digital numbers of a picture: in a region, and along a straight line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from optics.validation import require_unmasked


@dataclass(frozen=True)
class Region:
    """A rectangle of whole pixels in a picture.

    Parameters
    ----------
    top, left : int
        Row and column of its first pixel, from 0.
    rows, columns : int
        Size in pixels, 1 at least.

    Raises
    ------
    ValueError
        For a size below 1.
    """

    top: int
    left: int
    rows: int
    columns: int

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise ValueError(
                f"the region is {self.rows} x {self.columns} pixels; give 1 at least on each side"
            )

    def within(self, shape: tuple[int, int]) -> Region:
        """Return the part, of one pixel at least, that lies in a picture of (rows, columns).

        Raises ValueError if no part of it does.
        """
        top, left = max(self.top, 0), max(self.left, 0)
        rows = min(self.top + self.rows, shape[0]) - top
        columns = min(self.left + self.columns, shape[1]) - left
        if rows < 1 or columns < 1:
            raise ValueError(
                f"the region from row {self.top} and column {self.left} on lies outside the "
                f"picture of {shape[0]} x {shape[1]} pixels; move it inside"
            )
        return Region(top, left, rows, columns)

    def of(self, numbers: NDArray[Any]) -> NDArray[Any]:
        """Return the region's pixels of a picture in which it lies, (rows, columns), as a view."""
        rows = slice(self.top, self.top + self.rows)
        return numbers[rows, self.left : self.left + self.columns]


@dataclass(frozen=True)
class RegionStatistics:
    """The digital numbers of a region, summed up.

    Parameters
    ----------
    pixels : int
        Number of pixels.
    mean, deviation : float
        Mean and standard deviation over the region, DN. The deviation has the scene's own
        variation in it, beside noise.
    lowest, highest : int
        Smallest and largest number, DN.
    saturated, at_zero : int
        Pixels at full scale and at 0.
    """

    pixels: int
    mean: float
    deviation: float
    lowest: int
    highest: int
    saturated: int
    at_zero: int


def region_statistics(
    numbers: NDArray[np.integer[Any]], region: Region, full_scale: int
) -> RegionStatistics:
    """Return the statistics of a region of a picture.

    Parameters
    ----------
    numbers : NDArray of integers, (rows, columns)
        Digital numbers as the camera gave them.
    region : Region
        What is measured; the part of it within the picture counts.
    full_scale : int
        Digital number from which on a pixel is saturated.

    Returns
    -------
    RegionStatistics
        In digital numbers.

    Raises
    ------
    ValueError
        If the region lies outside the picture.
    """
    require_unmasked(numbers)
    part = region.within((numbers.shape[0], numbers.shape[1])).of(numbers)
    return RegionStatistics(
        pixels=part.size,
        mean=float(part.mean(dtype=np.float64)),
        deviation=float(part.std(dtype=np.float64)),
        lowest=int(part.min()),
        highest=int(part.max()),
        saturated=int(np.count_nonzero(part >= full_scale)),
        at_zero=int(np.count_nonzero(part == 0)),
    )


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
        if not all(0 <= c <= n - 1 for c, n in zip(place, numbers.shape, strict=True)):
            raise ValueError(
                f"{name} is row {place[0]:g}, column {place[1]:g}; the picture has "
                f"{numbers.shape[0]} x {numbers.shape[1]} pixels, counted from 0"
            )
    length = math.dist(start, end)
    share = np.linspace(0.0, 1.0, math.ceil(length) + 1)
    places = [first + share * (last - first) for first, last in zip(start, end, strict=True)]
    values = ndimage.map_coordinates(numbers, places, np.float64, order=1, mode="nearest")
    return LineProfile(share * length, values)
