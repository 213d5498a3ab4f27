"""From raw digital numbers to what the screen shows, with clipped pixels kept apart.

A raw picture becomes an index picture: 0 is clipped at zero, 255 is saturated, and
everything between is a grey. The marks follow from the raw numbers alone, whatever the
contrast levels are.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.window.theme import BLACK, SATURATED

_BINS = 4096
SATURATED_INDEX = 255
_BLACK_INDEX, _WHITE_INDEX = 1, 254
_SMALLEST_SPAN = 16
"""Digital numbers between black and white at the least, so that noise stays noise."""


@dataclass(frozen=True)
class DigitalScale:
    """What digital numbers mean: from zero to the one at which a pixel is saturated."""

    full_scale: int = 4095

    @property
    def numbers(self) -> int:
        return self.full_scale + 1


def histogram(image: NDArray[np.uint16], scale: DigitalScale) -> tuple[NDArray[np.float32], float]:
    """Pixels per bin over the whole frame and the whole range, and a bin's width in DN."""
    bins = min(_BINS, scale.numbers)
    counts = cv2.calcHist([image], [0], None, [bins], [0, scale.numbers])
    return np.asarray(counts, dtype=np.float32).ravel(), scale.numbers / bins


def auto_levels(counts: NDArray[np.float32], width: float) -> tuple[float, float]:
    """Levels that leave out the darkest 0.5 % and the brightest 0.01 % of the pixels."""
    share = np.cumsum(counts)
    total = float(share[-1])
    low = float(np.searchsorted(share, 0.005 * total)) * width
    high = float(np.searchsorted(share, 0.9999 * total) + 1) * width
    return low, max(high, low + _SMALLEST_SPAN)


def index_picture(
    image: NDArray[np.uint16], levels: tuple[float, float], scale: DigitalScale
) -> NDArray[np.uint8]:
    """The index picture of a raw picture at contrast levels (black, white) in DN."""
    low, high = levels
    numbers = np.arange(max(scale.numbers, int(image.max(initial=0)) + 1), dtype=np.float32)
    share = np.clip((numbers - low) / max(high - low, 1e-6), 0, 1)
    table = (_BLACK_INDEX + np.rint(share * (_WHITE_INDEX - _BLACK_INDEX))).astype(np.uint8)
    table[0] = 0
    table[scale.full_scale :] = SATURATED_INDEX
    return table[image]


def spread_saturated(indices: NDArray[np.uint8], reduction: int) -> NDArray[np.uint8]:
    """Saturated pixels made so large that none is lost when the screen skips pixels."""
    if reduction <= 1:
        return indices
    saturated = (indices == SATURATED_INDEX).astype(np.uint8)
    wider = cv2.dilate(saturated, np.ones((reduction, reduction), np.uint8))
    return np.where(np.asarray(wider) > 0, np.uint8(SATURATED_INDEX), indices)


def build_palette(*, mark_clipping: bool) -> NDArray[np.uint8]:
    """Red, green and blue of the 256 indices; unmarked, clipped pixels are black and white."""
    grey = np.zeros(256)
    grey[_BLACK_INDEX : _WHITE_INDEX + 1] = np.linspace(0, 255, _WHITE_INDEX - _BLACK_INDEX + 1)
    grey[SATURATED_INDEX] = 255
    colours = np.repeat(grey[:, None], 3, axis=1).astype(np.uint8)
    if mark_clipping:
        colours[0], colours[SATURATED_INDEX] = BLACK, SATURATED
    return colours
