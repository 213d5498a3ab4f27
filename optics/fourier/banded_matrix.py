"""Multiply lines of samples by a matrix that is zero but for a band."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

_BLOCK = 16
"""Rows that are multiplied at a time; of 8, 16 and 32 the fastest for 901 rows of 8 entries."""

STEPS_PER_ROW = 2.0
"""Time to make the dense blocks, for each row, over that of a step of Python; measured."""


class BandedMatrix:
    """Multiplies lines of samples by a matrix with a few entries in each row, side by side.

    Some rows at a time are multiplied by a small dense matrix.

    entries: those that may differ from zero, (rows, width).
    first: column of the first entry of each row, (rows,), int64, ascending. Entries outside the
        matrix must be zero, or belong to a mirrored one.
    columns: of the matrix.
    mirrored: whether an entry of a negative column stands in the column of the opposite number: the
        lines that are multiplied are even in their number.
    """

    def __init__(
        self, entries: torch.Tensor, first: torch.Tensor, columns: int, *, mirrored: bool = False
    ) -> None:
        self.shape = (entries.shape[0], columns)
        self._entries, self._first, self._mirrored = entries, first, mirrored
        self._blocks: list[tuple[slice, slice, torch.Tensor]] | None = None

    @property
    def bytes(self) -> int:
        """Bytes of the entries and of the dense blocks, about."""
        rows, width = self._entries.shape
        span = width + _BLOCK * self.shape[1] / max(rows, 1)
        return int(self._entries.element_size() * rows * (width + span))

    def blocks(self, device: torch.device) -> list[tuple[slice, slice, torch.Tensor]]:
        """Return the dense blocks on a device: rows, columns and entries."""
        blocks = self._blocks
        if blocks is None or blocks[0][2].device != device:
            entries, first = self._entries.cpu().numpy(), self._first.cpu().numpy()
            starts = range(0, self.shape[0], _BLOCK)
            # Another thread may make those of another device at the same time.
            blocks = self._blocks = [
                self._block(start, entries[start:][:_BLOCK], first[start:][:_BLOCK], device)
                for start in starts
            ]
        return blocks

    def _block(
        self, start: int, entries: NDArray[Any], first: NDArray[np.int64], device: torch.device
    ) -> tuple[slice, slice, torch.Tensor]:
        """Return the dense block of the rows from `start` on, with its rows and columns.

        entries, first: of its rows.
        """
        columns = first[:, None] + np.arange(entries.shape[1])
        if self._mirrored:
            columns = np.abs(columns)
        inside = (columns >= 0) & (columns < self.shape[1])
        found = columns[inside]
        begin, end = (int(found.min()), int(found.max()) + 1) if found.size else (0, 0)
        dense = np.zeros((len(entries), end - begin), entries.dtype)
        row = np.broadcast_to(np.arange(len(entries))[:, None], columns.shape)[inside]
        if self._mirrored:
            np.add.at(dense, (row, found - begin), entries[inside])
        else:
            dense[row, found - begin] = entries[inside]
        rows = slice(start, start + len(entries))
        return rows, slice(begin, end), torch.from_numpy(dense).to(device)

    def forward(self, lines: torch.Tensor) -> torch.Tensor:
        """Multiply by the matrix, from (columns, lines) to (rows, lines)."""
        product = lines.new_empty(self.shape[0], lines.shape[1])
        for rows, columns, block in self.blocks(lines.device):
            torch.mm(block, lines[columns], out=product[rows])
        return product

    def adjoint(self, lines: torch.Tensor) -> torch.Tensor:
        """Multiply by the conjugate transpose, from (rows, lines) to (columns, lines)."""
        product = lines.new_zeros(self.shape[1], lines.shape[1])
        for rows, columns, block in self.blocks(lines.device):
            product[columns].addmm_(block.mH, lines[rows])
        return product
