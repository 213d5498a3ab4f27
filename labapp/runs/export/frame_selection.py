"""Which frames of a record are asked for, and which of them are there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labapp.common.errors import UserError
from labapp.files.frame_list import read_frame_list
from labapp.runs.record.reader import Record


@dataclass(frozen=True)
class FrameSelection:
    """Which frames: a list such as "0-9,12", a target, a pattern; None: all of them."""

    frames: str | None = None
    target: str | None = None
    pattern: str | None = None


def select_frames(record: Record, selection: FrameSelection) -> list[int]:
    """Indices of the frames that are asked for, stored or not; UserError if there are none."""
    total = record.frame_count
    chosen = (
        read_frame_list(selection.frames, total) if selection.frames is not None else range(total)
    )
    keep = np.zeros(total, bool)
    keep[list(chosen)] = True
    known = {"target": record.target_names, "pattern": record.pattern_names}
    for column, names in known.items():
        name = getattr(selection, column)
        if name is None:
            continue
        if name not in names:
            raise UserError(f"--{column}: {name!r} is none of the record's: {', '.join(names)}.")
        keep &= record.column(column) == names.index(name)
    if not keep.any():
        raise UserError(f"{record.path}: no frame is all that was asked for. Ask for less.")
    return np.flatnonzero(keep).tolist()
