"""Tell where the light of a PSF from a file lies, and move an origin from the corner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from optics.inverse.psf_origin import centroid_offset, has_origin_in_corner

_TOLD_OFFSET = 0.45
"""Offset of a PSF's light in pixels from which it's told. Chosen: that of an even PSF whose middle
lies between two pixels is told."""


def place_psf(path: Path, psf: NDArray[np.floating]) -> tuple[NDArray[np.floating], list[str]]:
    """Return PSFs with their origin at index n // 2, and remarks for the user.

    Wrapped light shows that the origin is in the corner. Otherwise all stays where it is: a
    measured PSF's light needn't lie about its origin.

    psf: (bands, rows, columns); the place is the same in all bands.
    """
    said, whole = [], psf.sum(0, dtype=np.float64)
    if has_origin_in_corner(whole):
        psf, whole = (np.fft.fftshift(one, (-2, -1)) for one in (psf, whole))
        said.append(
            f"{path}: its light wraps round the edges; its origin was taken to be in the corner, "
            "as FFTs have it, and moved to the middle."
        )
    down, along = centroid_offset(torch.from_numpy(whole))
    if max(abs(down), abs(along)) > _TOLD_OFFSET:
        said.append(
            f"{path}: its light lies {_way(down, 'down', 'up')} and {_way(along, 'right', 'left')} "
            "of the middle pixel, index n // 2, where its origin is taken to be; if that is wrong, "
            "the restored picture is only moved by as much the other way."
        )
    return psf, said


def _way(pixels: float, positive: str, negative: str) -> str:
    return f"{abs(pixels):.1f} px {positive if pixels > 0 else negative}"
