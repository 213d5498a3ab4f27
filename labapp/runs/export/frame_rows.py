"""The columns of a record as rows, one for each exported frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from labapp.files.plan_file import ROLES
from labapp.runs.record import layout
from labapp.runs.record.reader import Record

_AT_ONCE = 1024
"""Rows that are made at once. Chosen: little memory, little loss."""


class FrameRows:
    """Rows of the exported frames, with names in place of the indices of names.

    They are kept as arrays, and made into rows while somebody goes through them.
    """

    def __init__(self, record: Record, frames: Sequence[int]) -> None:
        chosen = np.asarray(frames, np.intp)
        self.columns = (*layout.PLANNED, *layout.MEASURED)
        self._values = {name: record.column(name)[chosen] for name in self.columns}
        self._names: dict[str, Sequence[str]] = {
            "target": record.target_names,
            "pattern": record.pattern_names,
            "role": ROLES,
            "readout": [one.describe() or "whole frame" for one in record.readouts],
        }

    def __len__(self) -> int:
        return len(self._values["frame"])

    def __iter__(self) -> Iterator[dict[str, Any]]:
        blocks = zip(*(self.blocks(name) for name in self.columns), strict=True)
        for block in blocks:
            for row in zip(*block, strict=True):
                yield dict(zip(self.columns, row, strict=True))

    def blocks(self, name: str) -> Iterator[list[Any]]:
        """Yield a column in blocks of plain values."""
        names = self._names.get(name)
        for first in range(0, len(self), _AT_ONCE):
            values = self._values[name][first : first + _AT_ONCE].tolist()
            yield values if names is None else [_name_at(value, names) for value in values]

    def distinct(self, name: str) -> list[Any]:
        """Return the different values of a column of numbers."""
        return np.unique(self._values[name]).tolist()


def column_heading(name: str) -> str:
    """Return a column's heading in a table: its name with its unit."""
    unit = layout.UNITS.get(name, "").replace("/", "_per_")
    return f"{name}_{unit}" if unit else name


def _name_at(number: int, names: Sequence[str]) -> str:
    return names[number] if number < len(names) else f"unknown {number}"
