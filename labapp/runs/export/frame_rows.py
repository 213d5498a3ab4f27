"""The columns of a record as rows, one for each exported frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from labapp.runs.record import layout
from labapp.runs.record.reader import Record

FrameRows = list[dict[str, Any]]
"""The record's columns for each frame, with names in place of the indices of names."""


def frame_rows(record: Record, frames: Sequence[int]) -> FrameRows:
    names = {
        "target": record.target_names,
        "pattern": record.pattern_names,
        "role": layout.ROLES,
    }
    columns = {}
    for name in (*layout.PLANNED, *layout.MEASURED):
        values = record.column(name)[list(frames)].tolist()
        columns[name] = (
            [_name_at(value, names[name]) for value in values] if name in names else values
        )
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def column_heading(name: str) -> str:
    """Return the heading of a record's column in an export's table: its name with its unit."""
    unit = layout.UNITS.get(name, "").replace("/", "_per_")
    return f"{name}_{unit}" if unit else name


def _name_at(number: int, names: Sequence[str]) -> str:
    return names[number] if number < len(names) else f"unknown {number}"
