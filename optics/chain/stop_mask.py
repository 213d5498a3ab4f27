"""Mask a field at the lens by the stop, block by block of rows.

Only the cells that the stop's edge cuts are stored as numbers.
"""

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
"""Samples in a coarse cell, which is open, closed or cut by the edge as a whole. Sixteen rows of a
fine grid still fit into a processor's cache."""


@dataclass(frozen=True)
class MaskSegment:
    """Describes a range of columns, in a block of rows, where the stop isn't fully open.

    first, last: columns, the last one exclusive. share: open area of every sample, (rows, columns);
    None where all are closed.
    """

    first: int
    last: int
    share: torch.Tensor | None


class BlockwiseStopMask:
    """Masks fields on a plane by the open area of a stop, in blocks of rows.

    radius: of the stop, metres. Open areas are computed only along the stop's edge.
    """

    def __init__(self, stop: Stop, radius: float, plane: Plane, dtype: torch.dtype) -> None:
        self._stop, self._radius, self._plane, self._dtype = stop, radius, plane, dtype

    @property
    def row_blocks(self) -> list[slice]:
        count = self._plane.shape[0]
        return [slice(at, min(at + _CELL_ROWS, count)) for at in range(0, count, _CELL_ROWS)]

    @cached_property
    def segments_by_block(self) -> list[list[MaskSegment]]:
        """The column ranges, in each block of rows, where the chain's stop isn't fully open."""
        fine = Coverage(self._stop, self._radius, self._plane)
        lines = zip(self.row_blocks, self._coarse_coverage(), strict=True)
        return [self._find_segments(fine, rows, line) for rows, line in lines]

    def _coarse_coverage(self) -> NDArray[np.float64]:
        plane, sides = self._plane, (_CELL_ROWS, _CELL_COLUMNS)
        shape = [math.ceil(n / side) for n, side in zip(plane.shape, sides, strict=True)]
        pitch = [p * side for p, side in zip(plane.pitch, sides, strict=True)]
        # The middle of a coarse cell lies between two samples.
        centre = [
            self._sample_position(axis, 0)
            - plane.pitch[axis] / 2
            + (shape[axis] // 2 + 0.5) * pitch[axis]
            for axis in (0, 1)
        ]
        coarse = Plane((shape[0], shape[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))
        return np.asarray(coverage(self._stop, self._radius, coarse).numpy())

    def _sample_position(self, axis: int, number: int) -> float:
        """Return where a sample of the chain's lens grid lies along an axis, in metres."""
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
        """Multiply a block of the field at the chain's lens by the stop's open share, in place.

        field: (rows, columns) of the block.
        """
        for segment in self.segments_by_block[block]:
            part = field[:, segment.first : segment.last]
            if segment.share is None:
                part.zero_()
            else:
                # Two real products take less time than one with a complex share.
                parts = torch.view_as_real(part)
                parts.mul_(segment.share.to(field.device)[..., None])

    def open_power(self, field: torch.Tensor, block: int) -> float:
        """Sum ``|field|²`` of a block at the chain's lens over the open part of the stop.

        field: (rows, columns) of the block.
        """
        light = field.real**2 + field.imag**2
        total = float(light.sum(dtype=torch.float64))
        for segment in self.segments_by_block[block]:
            part = light[:, segment.first : segment.last]
            if segment.share is not None:
                part = part * (1 - segment.share)
            total -= float(part.sum(dtype=torch.float64))
        return total
