"""Demosaicing of a Bayer mosaic by the interpolations of OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch

Interpolation = Literal["bilinear", "edge-aware", "vng"]

INTERPOLATIONS: tuple[Interpolation, ...] = ("bilinear", "edge-aware", "vng")

_SUFFIX = {"bilinear": "", "edge-aware": "_EA", "vng": "_VNG"}

BAYER = ("RGGB", "GRBG", "BGGR", "GBRG")
"""The four Bayer patterns, row by row from the first pixel."""


def interpolate_bayer(
    raw: torch.Tensor, pattern: Sequence[str], interpolation: Interpolation
) -> torch.Tensor:
    """Demosaic a Bayer mosaic, (rows, columns), to red, green and blue by OpenCV.

    OpenCV computes in whole numbers. The range of the frame is scaled to 16 bits, or to 8 bits for
    "vng" (variable number of gradients). The result is (3, rows, columns). Raises ValueError for
    another pattern, or for a frame below 8 x 8 pixels.
    """
    import cv2

    name = "".join(pattern)
    if name not in BAYER or len(pattern) != 2:
        raise ValueError(
            f"pattern is {tuple(pattern)}; OpenCV knows Bayer's alone, as ('RG', 'GB'): take "
            "method='prior' for others"
        )
    # The edge-aware interpolation of a smaller frame computes nothing but its border.
    if min(raw.shape) < 8:
        raise ValueError(f"raw is {tuple(raw.shape)}; OpenCV needs 8 x 8 pixels")
    top = 255 if interpolation == "vng" else 65535
    low, high = float(raw.min()), float(raw.max())
    unit = (high - low) / top if high > low else 1.0
    whole = ((raw.detach().double() - low) / unit).round().numpy()
    whole = whole.astype(np.uint8) if interpolation == "vng" else whole.astype(np.uint16)
    code = getattr(cv2, f"COLOR_Bayer{name}2RGB{_SUFFIX[interpolation]}")
    colours = torch.from_numpy(np.ascontiguousarray(cv2.cvtColor(whole, code)))
    return (colours.to(torch.float64).movedim(-1, 0) * unit + low).to(raw.dtype)
