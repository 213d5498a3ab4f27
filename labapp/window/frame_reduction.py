"""Reduction of a raw frame to what a screen shows of it: palette indices, marks, a histogram."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.window.tone_mapping import DigitalScale, auto_levels, histogram, index_table

_LARGEST = float(np.iinfo(np.uint16).max)

Region = tuple[int, int, int, int]
"""Part of a frame: its first row, first column, rows and columns."""


@dataclass(frozen=True)
class FrameView:
    """What part of live frames is visible, how large, and with which contrast.

    region: visible part, pixels of the frame; None for all of it.
    size: rows and columns of screen pixels that the region covers.
    levels: contrast levels (black, white), DN; None for levels that follow every frame.
    """

    region: Region | None = None
    size: tuple[int, int] = (600, 900)
    levels: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class ReducedFrame:
    """What a screen shows of a raw frame.

    view: what the frame was reduced for.
    indices: palette indices of the region, (rows, columns): one for each screen pixel where the
        region is reduced, one for each frame pixel where it is magnified.
    region: part of the frame that `indices` show.
    counts: histogram of all pixels of the frame.
    bin_width: DN.
    levels: contrast levels (black, white), DN.
    saturated: saturated pixels in the whole frame.
    """

    view: FrameView
    indices: NDArray[np.uint8]
    region: Region
    counts: NDArray[np.float32]
    bin_width: float
    levels: tuple[float, float]
    saturated: int


def reduce_frame(image: NDArray[np.uint16], view: FrameView, scale: DigitalScale) -> ReducedFrame:
    """Reduce a raw frame in DN, (rows, columns), to a view; a region beyond the frame is clipped.

    A reduced pixel shows the mean of the pixels under it. It is marked as saturated if any of them
    is, so that every single saturated pixel is seen, and as zero only if all of them are. Histogram
    and count are of all pixels of the frame, whatever the view shows.
    """
    counts, width = histogram(image, scale)
    levels = view.levels or auto_levels(counts, width)
    clipped = np.asarray(cv2.inRange(image, (float(scale.full_scale),), (_LARGEST,)), np.uint8)
    saturated = int(cv2.countNonZero(clipped))
    region = _clip(view.region, image.shape)
    row, column, rows, columns = region
    part = np.s_[row : row + rows, column : column + columns]
    size = _picture_size((rows, columns), view.size)
    table = index_table(levels, scale)
    # A number beyond the largest one, which some cameras send, is saturated as well.
    indices = np.take(table, _reduce_mean(image[part], size), mode="clip")
    if saturated:
        indices = np.maximum(indices, _reduce_marks(clipped[part], size))
    return ReducedFrame(view, indices, region, counts, width, levels, saturated)


def _clip(region: Region | None, shape: tuple[int, ...]) -> Region:
    """Return the part of a region that lies in a frame; the whole frame if none does."""
    if region is None:
        return 0, 0, shape[0], shape[1]
    row, column, rows, columns = region
    last_row, last_column = min(row + rows, shape[0]), min(column + columns, shape[1])
    row, column = max(row, 0), max(column, 0)
    if last_row <= row or last_column <= column:
        return 0, 0, shape[0], shape[1]
    return row, column, last_row - row, last_column - column


def _picture_size(pixels: tuple[int, int], screen: tuple[int, int]) -> tuple[int, int]:
    """Return rows and columns of the picture of some rows and columns of a frame.

    A magnified picture has the frame's own pixels, which the view enlarges.
    """
    if screen[0] >= pixels[0] or screen[1] >= pixels[1]:
        return pixels
    return screen


def _reduce_mean(part: NDArray[np.uint16], size: tuple[int, int]) -> NDArray[np.uint16]:
    """Reduce a part of a frame to the means of neighbouring pixels.

    Halving by exact means of 2 x 2 pixels and interpolating the rest takes an eighth of the time of
    exact means over fractions of pixels (measured, 5 megapixels). A last odd row or column is left
    out in halving.
    """
    rows, columns = size
    while part.shape[0] >= 2 * rows and part.shape[1] >= 2 * columns:
        half = (part.shape[1] // 2, part.shape[0] // 2)
        even = part[: 2 * half[1], : 2 * half[0]]
        part = np.asarray(cv2.resize(even, half, interpolation=cv2.INTER_AREA), dtype=np.uint16)
    if part.shape != size:
        resized = cv2.resize(part, (columns, rows), interpolation=cv2.INTER_LINEAR)
        return np.asarray(resized, dtype=np.uint16)
    return part


def _reduce_marks(clipped: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Reduce marks of saturated pixels, so that none is lost.

    Marks are 255, the palette index of saturated pixels, or 0. Each one spreads over the pixels of
    the frame that OpenCV's nearest neighbour may take for the reduced pixel in which it lies: those
    up to a reduced pixel before it.
    """
    if clipped.shape == size:
        return clipped
    spread = [_spread(one / there) for one, there in zip(clipped.shape, size, strict=True)]
    wide = cv2.dilate(clipped, np.ones(spread, np.uint8), anchor=(0, 0))
    reduced = cv2.resize(wide, size[::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(reduced, dtype=np.uint8)


def _spread(reduction: float) -> int:
    """Return over how many pixels a mark spreads, for pixels per reduced pixel."""
    return round(reduction) if reduction == round(reduction) else math.ceil(reduction) + 1
