"""The check of a record's copy: whether all that stands before the log stands once more.

A row is written to the copy first. So a writer that was killed may leave one row of one dataset in
which the copy is ahead, and must be what comes next. Of a run that has ended, it's only the state
that a writer gives up as it opens the record again.
"""

from __future__ import annotations

import os
from itertools import islice
from typing import Any

from labapp.runs.record import layout
from labapp.runs.record.chain import follows
from labapp.runs.record.digest_checks import is_closed_as, is_half_written, is_time
from labapp.runs.record.digests import SETTINGS
from labapp.runs.record.place_table import PlaceTable
from labapp.runs.record.reader import Record
from labapp.runs.record.second_copy import differing_rows, find_copy, read_both
from labapp.runs.record.verification import StatusAndDetail
from labapp.runs.state import State

_SEEN = 100
"""Rows that are looked at: one may differ, and of more some are named. Chosen."""

_ENTRY, _DIGESTS = layout.ENTRY, layout.DIGESTS


def check_copy(record: Record) -> StatusAndDetail:
    """Check that all that stands twice is the same twice."""
    if record.structure is None:
        if record.format == layout.FORMAT:
            return "WRONG", "the table of places is missing or damaged, which tells where it is"
        return "note", "none: of an older format"
    table = record.structure.table
    if find_copy(table) is None:
        return "note", "none: of an older format"
    state = record.state
    handle = os.open(record.path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        rows = list(islice(differing_rows(handle, table), _SEEN))
        if not state.has_ended and state is not State.INTERRUPTED:
            # While it is compared, the writer goes on.
            rows = [(name, row) for name, row in rows if name not in layout.CHANGING]
        is_next = len(rows) == 1 and _is_next(record, handle, table, *rows[0])
        if rows and not is_next:
            names = ", ".join(sorted({name for name, _ in rows}))
            return "WRONG", f"differs from what it is of: {names}"
    finally:
        os.close(handle)
    return "ok", "all that frames need stands twice, the same"


def _is_next(record: Record, handle: int, table: PlaceTable, name: str, row: int) -> bool:
    """Return whether a row of the copy is what the writer writes next."""
    if name not in layout.CHANGING or name == layout.COPY:
        return False
    own, second = (one[row] for one in read_both(handle, table, name))
    if record.state.has_ended:
        # A writer that opens the record again begins with this.
        return name == f"{_ENTRY}/state" and bool(second == State.PLANNED.value.encode())
    group, _, column = name.rpartition("/")
    if group == _ENTRY:
        return _is_next_text(column, own, second)
    if group == _DIGESTS:
        return _is_next_digest(record, column, row, second)
    chain = record.frame_chain
    if column == "stored":
        return chain.latest[row] == chain.length - 1 >= 0 and {int(own), int(second)} == {0, 1}
    settings = {one: record.column(one)[row] for one in SETTINGS}
    # By its bits: -0.0 equals 0, and was never written.
    is_new = not chain.linked[row] and not any(own.tobytes())
    return is_new and is_half_written(record, row, settings | {column: second})


def _is_next_text(name: str, own: Any, second: Any) -> bool:
    """Return whether a row of the entry may be what the writer writes next."""
    if name == "log_lost":
        return bool(second == own + 1)
    # Nothing protects state, message and writer before the run's end.
    return name != "end_time" or not second or is_time(second.decode(errors="replace"))


def _is_next_digest(record: Record, name: str, row: int, second: Any) -> bool:
    """Return whether a digest may be what the writer writes next."""
    if name == "chain":
        return row == record.frame_chain.length and follows(second, record.frame_chain.last)
    digest = second.tobytes().hex()
    return name == "closing" and (
        not second.any() or any(is_closed_as(record, one, digest) for one in State)
    )
