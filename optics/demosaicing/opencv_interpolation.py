"""OpenCV's interpolations of Bayer's mosaic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch

Interpolation = Literal["bilinear", "edge-aware", "vng"]

INTERPOLATIONS: tuple[Interpolation, ...] = ("bilinear", "edge-aware", "vng")

_SUFFIX = {"bilinear": "", "edge-aware": "_EA", "vng": "_VNG"}

BAYER = ("RGGB", "GRBG", "BGGR", "GBRG")
"""Row by row, from the first pixel."""

_MIN_SIDE = 8
"""Rows and columns below which its edge-aware one leaves nothing but border."""


def interpolate_bayer(
    raw: torch.Tensor, pattern: Sequence[str], interpolation: Interpolation
) -> torch.Tensor:
    """(3, rows, columns): red, green, blue of a Bayer mosaic, (rows, columns), by OpenCV.

    OpenCV computes in whole numbers: the frame's own range becomes 16 bits, of "vng" (variable
    numbers of gradients) 8. Raises ValueError for another pattern, or a frame below 8 x 8.
    """
    import cv2

    name = "".join(pattern)
    if name not in BAYER or len(pattern) != 2:
        raise ValueError(
            f"pattern is {tuple(pattern)}; OpenCV knows Bayer's alone, as ('RG', 'GB'): take "
            "method='prior' for others"
        )
    if min(raw.shape) < _MIN_SIDE:
        raise ValueError(
            f"raw is {tuple(raw.shape)}; OpenCV needs {_MIN_SIDE} x {_MIN_SIDE} pixels"
        )
    top = 255 if interpolation == "vng" else 65535
    low, high = float(raw.min()), float(raw.max())
    unit = (high - low) / top if high > low else 1.0
    whole = ((raw.detach().double() - low) / unit).round().numpy()
    whole = whole.astype(np.uint8) if interpolation == "vng" else whole.astype(np.uint16)
    code = getattr(cv2, f"COLOR_Bayer{name}2RGB{_SUFFIX[interpolation]}")
    colours = torch.from_numpy(np.ascontiguousarray(cv2.cvtColor(whole, code)))
    return (colours.to(torch.float64).movedim(-1, 0) * unit + low).to(raw.dtype)
