"""The stop on a grid at the lens, block by block: only what its edge cuts is kept."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray

from optics.plane import Plane
from optics.stop.aperture import Stop
from optics.stop.coverage import Coverage, coverage

_CELL_ROWS, _CELL_COLUMNS = 16, 64
"""Samples in a cell of the coarse picture, in which whole cells are open or closed. Sixteen rows
of a fine grid still fit into a processor's cache."""


@dataclass(frozen=True)
class MaskSegment:
    """Samples of a block's rows that aren't open: columns first to last, exclusive.

    share: open area of every sample, (rows, columns); None where all are closed.
    """

    first: int
    last: int
    share: torch.Tensor | None


class BlockwiseStopMask:
    """A stop's covered area on a plane, by blocks of rows.

    radius: of the stop, metres. Covered areas are made where the edge runs and nowhere else.
    """

    def __init__(self, stop: Stop, radius: float, plane: Plane, dtype: torch.dtype) -> None:
        self._stop, self._radius, self._plane, self._dtype = stop, radius, plane, dtype

    @property
    def row_blocks(self) -> list[slice]:
        count = self._plane.shape[0]
        return [slice(at, min(at + _CELL_ROWS, count)) for at in range(0, count, _CELL_ROWS)]

    @cached_property
    def segments_by_block(self) -> list[list[MaskSegment]]:
        """The stretches of every block."""
        fine = Coverage(self._stop, self._radius, self._plane)
        lines = zip(self.row_blocks, self._coarse_coverage(), strict=True)
        return [self._find_segments(fine, rows, line) for rows, line in lines]

    def _coarse_coverage(self) -> NDArray[np.float64]:
        plane, sides = self._plane, (_CELL_ROWS, _CELL_COLUMNS)
        shape = [math.ceil(n / side) for n, side in zip(plane.shape, sides, strict=True)]
        pitch = [p * side for p, side in zip(plane.pitch, sides, strict=True)]
        # The middle of a cell of the coarse picture lies between two samples.
        centre = [
            self._sample_position(axis, 0)
            - plane.pitch[axis] / 2
            + (shape[axis] // 2 + 0.5) * pitch[axis]
            for axis in (0, 1)
        ]
        coarse = Plane((shape[0], shape[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))
        return np.asarray(coverage(self._stop, self._radius, coarse).numpy())

    def _sample_position(self, axis: int, number: int) -> float:
        """Metres of a sample along an axis."""
        plane = self._plane
        return (number - plane.shape[axis] // 2) * plane.pitch[axis] + float(plane.centre[axis])

    def _find_segments(
        self, fine: Coverage, rows: slice, line: NDArray[np.float64]
    ) -> list[MaskSegment]:
        found: list[MaskSegment] = []
        kinds = np.where(line <= 0, 0, np.where(line >= 1, 2, 1))
        ends = [0, *(np.flatnonzero(np.diff(kinds)) + 1), kinds.size]
        for start, end in pairwise(ends):
            first, last = start * _CELL_COLUMNS, min(end * _CELL_COLUMNS, self._plane.shape[1])
            if kinds[start] == 1:
                share = fine.open_share(rows, slice(first, last)).to(self._dtype)
                found.append(MaskSegment(first, last, share))
            elif kinds[start] == 0:
                found.append(MaskSegment(first, last, None))
        return found

    def apply(self, field: torch.Tensor, block: int) -> None:
        """Close what is closed of a block's field (rows, columns), in its own memory."""
        for stretch in self.segments_by_block[block]:
            part = field[:, stretch.first : stretch.last]
            if stretch.share is None:
                part.zero_()
            else:
                # Two real products take less time than one with a share made complex.
                parts = torch.view_as_real(part)
                parts.mul_(stretch.share.to(field.device)[..., None])

    def open_power(self, field: torch.Tensor, block: int) -> float:
        """Sum of |field|² over what is open of a block (rows, columns)."""
        light = field.real**2 + field.imag**2
        total = float(light.sum(dtype=torch.float64))
        for stretch in self.segments_by_block[block]:
            part = light[:, stretch.first : stretch.last]
            if stretch.share is not None:
                part = part * (1 - stretch.share)
            total -= float(part.sum(dtype=torch.float64))
        return total
