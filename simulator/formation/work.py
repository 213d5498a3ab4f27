"""Operations of the steps of rendering a picture, both for predictions and for the ledger."""

from __future__ import annotations

import math

from optics.camera import Panel

_FIELD_OPERATIONS = 60.0
"""Operations per panel pixel from a grey level to a field."""


def transform_operations(rows: int, columns: int) -> float:
    """Return the operations of one real two-dimensional Fourier transform in image formation."""
    samples = rows * columns
    return 2.5 * samples * math.log2(max(samples, 2))


def psf_operations(panel: Panel, down: int, across: int) -> float:
    """Return the operations of rendering one PSF on `down` x `across` samples.

    The PSF takes chirped Fourier transforms of the panel along both axes.
    """
    rows, columns = panel.shape
    along = rows * (columns + across) * math.log2(columns + across)
    upright = across * (rows + down) * math.log2(rows + down)
    return 3 * 5 * (along + upright) + _FIELD_OPERATIONS * rows * columns


def ray_operations(panel: Panel, down: int, across: int) -> float:
    """Return the operations of rendering one geometric PSF on `down` x `across` samples."""
    # 80 operations per ray.
    return (80.0 + _FIELD_OPERATIONS) * panel.shape[0] * panel.shape[1] + down * across
