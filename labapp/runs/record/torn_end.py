"""Mend state and log after a power cut, which may take any of the file's last pages."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.record import layout
from labapp.runs.record.chain import AT_ONCE, LogChain, follow_log
from labapp.runs.record.digests import line_digest
from labapp.runs.record.place_table import PlaceTable
from labapp.runs.state import State

_LOG, _STATE = (f"{layout.ENTRY}/{name}" for name in ("log", "state"))


def mend_torn_end(handle: int, table: PlaceTable) -> list[str]:
    """Write state and log anew as far as a power cut took them.

    All lines that can be read are kept. Nothing is changed after the end of a run: all of its log
    was on the disk before. Returns what was done, in words.
    """
    done = []
    state = state_of(table.read(handle, _STATE).tobytes())
    if state is None:
        _write(handle, table, _STATE, 0, State.PLANNED.value.encode())
        done.append("the state, which was torn")
    if state is not None and state.has_ended:
        return []
    structure = table.read(handle, f"{layout.DIGESTS}/structure").tobytes()
    found = follow_log(table.read_blocks(handle, _LOG, AT_ONCE), structure)
    if found.broken is not None and _chain_anew(handle, table, found, found.broken):
        done.append(f"the log from line {found.broken} on, which lacks lines")
    return done


def state_of(data: bytes) -> State | None:
    """Return the state that these bytes tell; None if they tell none."""
    return next((one for one in State if one.value.encode() == data.rstrip(b"\0")), None)


def _chain_anew(handle: int, table: PlaceTable, found: LogChain, first: int) -> bool:
    """Chain what is left of the log behind a line that says so; false if it has no room."""
    left, end = _lines_left(handle, table, first)
    told = f"lines of the log were lost from here on; {len(left)} that were found follow"
    if first + 1 + len(left) > table.places[_LOG].shape[0]:
        return False
    before = found.last
    for row, (time, text) in enumerate([(0.0, told.encode()), *left], first):
        before = line_digest(before, time, text)
        _write(handle, table, _LOG, row, (time, text, np.frombuffer(before, np.uint8)))
    for row in range(first + 1 + len(left), end):
        _write(handle, table, _LOG, row, np.zeros((), layout.LOG_ROW))
    return True


def _lines_left(
    handle: int, table: PlaceTable, first: int
) -> tuple[list[tuple[float, bytes]], int]:
    """Return the lines of the log that can be read, and the row behind the last of any."""
    left, end = [], first
    for begin, rows in zip(count(0, AT_ONCE), table.read_blocks(handle, _LOG, AT_ONCE)):
        for place in _used(rows):
            if begin + place < first:
                continue
            end = begin + place + 1
            time, text = float(rows["time"][place]), bytes(rows["text"][place])
            if text and np.isfinite(time) and text.decode(errors="ignore").encode() == text:
                left.append((time, text))
    return left, end


def _used(rows: NDArray[Any]) -> list[int]:
    """Return the places of those rows that aren't zeros."""
    flat = rows.view(np.uint8).reshape(len(rows), -1)
    places: list[int] = np.flatnonzero(flat.any(axis=1)).tolist()
    return places


def _write(handle: int, table: PlaceTable, name: str, row: int, value: Any) -> None:
    table.write(handle, name, np.array(value, table.places[name].dtype).tobytes(), row)
