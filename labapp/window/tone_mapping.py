"""Mapping of live frames' raw digital numbers to colours, with clipping marked.

A raw picture becomes a picture of palette indices: 0 is clipped at zero, 255 is saturated, and the
indices between are greys. The marks depend on the raw numbers alone, not on the contrast levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

SATURATED = (255, 0, 0)
"""Red, green and blue of the mark on saturated pixels."""

BLACK = (40, 90, 255)
"""The same on pixels at zero, where the black level is too low for the noise without light."""

SATURATED_INDEX = 255
"""Palette index of saturated pixels."""

_BLACK_INDEX, _WHITE_INDEX = 1, 254
"""Palette indices of the darkest and the brightest grey."""


@dataclass(frozen=True)
class DigitalScale:
    """The camera's range of digital numbers; a pixel at `full_scale` is saturated."""

    full_scale: int = 4095

    @property
    def numbers(self) -> int:
        return self.full_scale + 1


def histogram(image: NDArray[np.uint16], scale: DigitalScale) -> tuple[NDArray[np.float32], float]:
    """Return a frame's histogram over the whole range: pixels per bin, and a bin's width in DN."""
    bins = min(4096, scale.numbers)
    counts = cv2.calcHist([image], [0], None, [bins], [0, scale.numbers])
    return np.asarray(counts, dtype=np.float32).ravel(), scale.numbers / bins


def auto_levels(counts: NDArray[np.float32], width: float) -> tuple[float, float]:
    """Return levels (black, white) in DN; 0.5 % dark and 0.01 % bright pixels lie outside."""
    share = np.cumsum(counts)
    total = float(share[-1])
    low = float(np.searchsorted(share, 0.005 * total)) * width
    high = float(np.searchsorted(share, 0.9999 * total) + 1) * width
    # With 16 DN between black and white at least, noise isn't stretched to full contrast.
    return low, max(high, low + 16)


def index_table(levels: tuple[float, float], scale: DigitalScale) -> NDArray[np.uint8]:
    """Return the palette index of every digital number at levels (black, white) in DN."""
    low, high = levels
    numbers = np.arange(scale.numbers, dtype=np.float32)
    share = np.clip((numbers - low) / max(high - low, 1e-6), 0, 1)
    table = (_BLACK_INDEX + np.rint(share * (_WHITE_INDEX - _BLACK_INDEX))).astype(np.uint8)
    table[0] = 0
    table[scale.full_scale :] = SATURATED_INDEX
    return table


def build_palette(*, mark_clipping: bool) -> NDArray[np.uint8]:
    """Return the palette, (256, 3), in which clipped pixels are marked, or black and white."""
    grey = np.zeros(256)
    grey[_BLACK_INDEX : _WHITE_INDEX + 1] = np.linspace(0, 255, _WHITE_INDEX - _BLACK_INDEX + 1)
    grey[SATURATED_INDEX] = 255
    colours = np.repeat(grey[:, None], 3, axis=1).astype(np.uint8)
    if mark_clipping:
        colours[0], colours[SATURATED_INDEX] = BLACK, SATURATED
    return colours
