"""Select the frames of a record that are exported."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labapp.common.errors import UserError
from labapp.files.frame_list import read_frame_list
from labapp.runs.record.reader import Record


@dataclass(frozen=True)
class FrameSelection:
    """Criteria for frames to export, of which those that aren't None must all be met.

    Parameters
    ----------
    frames : str, optional
        List of frame indices, such as "0-9,12".
    target : str, optional
        Name of a target.
    pattern : str, optional
        Name of a pattern.
    readout : int, optional
        Number of a way in which the sensor was read, from 0.
    """

    frames: str | None = None
    target: str | None = None
    pattern: str | None = None
    readout: int | None = None


def select_frames(record: Record, selection: FrameSelection) -> list[int]:
    """Return the indices of the frames that meet the criteria, stored or not.

    Raises UserError if there are none.
    """
    total = record.frame_count
    keep = np.full(total, selection.frames is None)
    if selection.frames is not None:
        keep[read_frame_list(selection.frames, total)] = True
    known = {"target": record.target_names, "pattern": record.pattern_names}
    for column, names in known.items():
        name = getattr(selection, column)
        if name is None:
            continue
        if name not in names:
            raise UserError(f"--{column}: {name!r} is none of the record's: {', '.join(names)}.")
        keep &= record.column(column) == names.index(name)
    if selection.readout is not None:
        keep &= record.column("readout") == record.chosen_readout
    if not keep.any():
        raise UserError(f"{record.path}: no frame is all that was asked for. Ask for less.")
    return np.flatnonzero(keep).tolist()
