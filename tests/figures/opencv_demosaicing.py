"""Demosaicing of a Bayer mosaic by the interpolations of OpenCV, to compare with."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

INTERPOLATIONS = {"bilinear": "", "edge-aware": "_EA", "vng": "_VNG"}
"""OpenCV's names of the interpolations, behind that of the pattern."""


def interpolate_bayer(
    raw: NDArray[np.floating], pattern: Sequence[str], interpolation: str
) -> NDArray[np.float32]:
    """Red, green and blue of a mosaic, (rows, columns).

    OpenCV computes in whole numbers: the frame's range is scaled to 16 bits, or to 8 for "vng".
    """
    top, kind = (255, np.uint8) if interpolation == "vng" else (65535, np.uint16)
    low, high = float(raw.min()), float(raw.max())
    unit = (high - low) / top if high > low else 1.0
    whole = ((raw.astype(np.float64) - low) / unit).round().astype(kind)
    name = f"COLOR_Bayer{''.join(pattern)}2RGB{INTERPOLATIONS[interpolation]}"
    colours = cv2.cvtColor(whole, getattr(cv2, name))
    return (np.moveaxis(colours, -1, 0) * unit + low).astype(np.float32)
