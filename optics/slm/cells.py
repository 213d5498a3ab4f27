"""Interpolate from coarse cells that cover a panel to the panel's pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from optics.validation import require_unmasked


def as_float64(values: Any) -> torch.Tensor:
    """Convert numbers of an SLM's map or response to a float64 tensor.

    The numbers may be of any kind. Tensors keep their derivatives.
    """
    if isinstance(values, torch.Tensor):
        return values.to(torch.float64)
    require_unmasked(values)
    # Arrays from files may be read-only or of another byte order, so the values are copied.
    return torch.from_numpy(np.array(values, dtype=np.float64))


def neighbouring_cells(cells: int, pixels: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Find the map cells before and behind each SLM pixel along an axis, and the pixel's position.

    The position is the share, from 0 to 1, of the way between the centres of the two cells. The
    cells are equally wide and cover all pixels. A pixel beyond the outermost centre gets the
    outermost cell alone. Returns two tensors of indices, int64, and the shares, float64, each
    (pixels,).
    """
    centre = (torch.arange(pixels, dtype=torch.float64) + 0.5) * (cells / pixels) - 0.5
    centre = centre.clamp(0, cells - 1)
    before = centre.floor().to(torch.int64)
    behind = (before + 1).clamp(max=cells - 1)
    return before, behind, centre - before


def interpolate_cells(values: torch.Tensor, pixels: int, axis: int) -> torch.Tensor:
    """Interpolate a map's cell values along an axis to SLM pixels, linearly.

    The values are constant beyond the outermost cells' centres.
    """
    if values.shape[axis] == pixels:
        return values
    before, behind, share = neighbouring_cells(values.shape[axis], pixels)
    lengths = [1] * values.ndim
    lengths[axis] = pixels
    share = share.to(values).reshape(lengths)
    low, high = values.index_select(axis, before), values.index_select(axis, behind)
    return low + share * (high - low)
