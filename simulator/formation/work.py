"""Operations of a picture's steps: counted where they are done, and predicted by the same rules."""

from __future__ import annotations

import math

from optics.camera import Panel

_PIXEL = 60.0
"""Operations by which a grey level becomes a field."""

_RAY = 80.0


def transform_operations(rows: int, columns: int) -> float:
    """Of one real two-dimensional Fourier transform."""
    samples = rows * columns
    return 2.5 * samples * math.log2(max(samples, 2))


def psf_operations(panel: Panel, down: int, across: int) -> float:
    """Of one PSF on `down` x `across` samples: chirped transforms of the panel, along both axes."""
    rows, columns = panel.shape
    along = rows * (columns + across) * math.log2(columns + across)
    upright = across * (rows + down) * math.log2(rows + down)
    return 3 * 5 * (along + upright) + _PIXEL * rows * columns


def ray_operations(panel: Panel, down: int, across: int) -> float:
    """Of one geometric blur."""
    return (_RAY + _PIXEL) * panel.shape[0] * panel.shape[1] + down * across
