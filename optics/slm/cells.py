"""Coarse cells that cover a panel, and the panel's pixels between their centres."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch


def as_float64(values: Any) -> torch.Tensor:
    """Numbers of any kind as a float64 tensor; derivatives of tensors stay."""
    if isinstance(values, torch.Tensor):
        return values.to(torch.float64)
    # A copy: arrays from files may be read-only or of a foreign byte order.
    return torch.from_numpy(np.array(values, dtype=np.float64))


def neighbouring_cells(cells: int, pixels: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """For every pixel along an axis the cells before and behind it, and how far it is between.

    The cells are equally wide and cover all pixels. Pixels nearer to the edge than any
    centre of a cell have that cell alone. Indices int64, share from 0 to 1 float64, (pixels,).
    """
    centre = (torch.arange(pixels, dtype=torch.float64) + 0.5) * (cells / pixels) - 0.5
    centre = centre.clamp(0, cells - 1)
    before = centre.floor().to(torch.int64)
    behind = (before + 1).clamp(max=cells - 1)
    return before, behind, centre - before


def interpolate_cells(values: torch.Tensor, pixels: int, axis: int) -> torch.Tensor:
    """Values of cells along an axis, interpolated to pixels; constant beyond the last centres."""
    if values.shape[axis] == pixels:
        return values
    before, behind, share = neighbouring_cells(values.shape[axis], pixels)
    lengths = [1] * values.ndim
    lengths[axis] = pixels
    share = share.to(values).reshape(lengths)
    low, high = values.index_select(axis, before), values.index_select(axis, behind)
    return low + share * (high - low)
