"""The checks of the digests, of frames, log and all, and of the copy of what stands before the log.

A row is written to the copy first. So a writer that was killed may leave one row of one dataset in
which the copy is ahead, and must be what comes next. Of a run that has ended, it's only the state
that a writer gives up as it opens the record again.
"""

from __future__ import annotations

import os
from datetime import datetime
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.files.frame_list import format_frame_list
from labapp.runs.frame_acceptance import WAVELENGTH_TOLERANCE, is_exposure_as_requested
from labapp.runs.record import layout
from labapp.runs.record.chain import follows
from labapp.runs.record.digests import SETTINGS
from labapp.runs.record.place_table import PlaceTable
from labapp.runs.record.reader import Record
from labapp.runs.record.second_copy import differing_rows, find_copy, read_both
from labapp.runs.record.verification import StatusAndDetail
from labapp.runs.state import State


def check_links(record: Record) -> StatusAndDetail:
    """Check that the frames' links follow from each other, and belong to their frames."""
    if not record.is_protected:
        return "note", "none: of an older format"
    chain = record.frame_chain
    if chain.broken is not None:
        return "WRONG", f"link {chain.broken} doesn't follow from those before it"
    stored = record.column("stored")
    if odd := np.flatnonzero(stored > 1).tolist():
        return "WRONG", f"`stored` is neither 0 nor 1: of frames {format_frame_list(odd)}"
    linked = chain.linked
    if chain.beyond:
        return "WRONG", f"links of frames that aren't planned: {format_frame_list(chain.beyond)}"
    if bare := np.flatnonzero((stored == 1) & ~linked).tolist():
        return "WRONG", f"stored without a link: frames {format_frame_list(bare)}"
    if wrong := _check_unacknowledged(record, np.flatnonzero(linked & (stored == 0)).tolist()):
        return wrong
    if bad := _written_without_link(record, linked):
        return "WRONG", f"settings of frames without a link: {format_frame_list(bad)}"
    return "ok", f"{chain.length} links of frames follow from each other"


def _check_unacknowledged(record: Record, frames: list[int]) -> StatusAndDetail | None:
    """Check frames that have a link, but aren't marked as stored.

    The link is written just before the mark, so a killed writer may leave one.
    """
    if not frames or record.state.is_under_way:
        return None
    chain = record.frame_chain
    if record.state is State.INTERRUPTED and chain.latest[frames].tolist() == [chain.length - 1]:
        return "unfinished", f"frame {frames[0]} is whole, but its writer ended before it said so"
    return "WRONG", f"linked, and yet not stored: frames {format_frame_list(frames)}"


def _written_without_link(record: Record, linked: NDArray[np.bool_]) -> list[int]:
    """Return the frames without a link in whose settings there is something.

    A killed writer may leave one that is half written: its first settings, in their order.
    """
    columns = {name: record.column(name) for name in SETTINGS}
    written = np.zeros(len(linked), bool)
    for column in columns.values():
        # By its bits: -0.0 equals 0, and was never written.
        written |= column.view(f"u{column.itemsize}") != 0
    found: list[int] = np.flatnonzero(written & ~linked).tolist()
    if len(found) == 1 and not record.state.has_ended:
        (frame,) = found
        if is_half_written(record, frame, {name: c[frame] for name, c in columns.items()}):
            return []
    return found


def is_half_written(record: Record, frame: int, settings: dict[str, float]) -> bool:
    """Return whether settings are the first of a frame that was taken as the plan asks."""
    last = max((number for number, value in enumerate(settings.values()) if value), default=-1)
    before = list(settings)[:last]
    if last < 0:
        return False
    # The bench's clock and a camera's count may begin at 0.
    if not all(settings[name] for name in before if name not in ("time", "number")):
        return False
    wavelength, asked = settings["wavelength"], record.column("wavelength_asked")[frame]
    return is_exposure_as_requested(
        settings["exposure"], record.column("exposure_asked")[frame]
    ) and (not wavelength or abs(wavelength - asked) <= WAVELENGTH_TOLERANCE)


def check_log(record: Record) -> StatusAndDetail:
    """Check that the lines of the log follow from each other; tell how many were lost."""
    lines, lost = sum(1 for _ in record.log_lines()), record.lost_log_lines
    if not record.is_protected:
        return "note", f"{lines} lines, which aren't protected: of an older format"
    chain = record.log_chain
    if chain.broken is not None:
        return "WRONG", f"line {chain.broken} doesn't follow from those before it"
    room = layout.log_capacity(record.frame_count)
    if lost and chain.length < room:
        return "WRONG", f"{lost} lines are said to be lost, though {room - chain.length} had room"
    more = f"; {lost} more had no room" if lost else ""
    return "ok", f"{lines} lines follow from each other{more}"


def check_closing(record: Record, expected: str = "") -> StatusAndDetail:
    """Check the digest over all, which the end of a run has written.

    expected: the digest that the end of the run printed, in hexadecimal; "" if unknown.
    """
    if not record.is_protected:
        if expected:
            return "WRONG", "the record is of an older format, which has no digest"
        return "note", "none: of an older format"
    written, state = record.closing_digest, record.state
    if not state.has_ended:
        return _check_unclosed(record, expected)
    if written != record.compute_closing_digest():
        return "WRONG", "the digest over all isn't that of this file: something has changed"
    if expected and written != expected.strip().lower():
        return "WRONG", f"the digest is {written}, not the one given: the record was changed"
    return "ok", f"{written}{', as given' if expected else ''}"


def _check_unclosed(record: Record, expected: str) -> StatusAndDetail:
    """Check that nothing says that a run has ended which hasn't.

    The time of the end, the digest over all and the state are written in this order, so a killed
    writer may leave the first, or the first two.
    """
    ended, written, state = record.end_time, record.closing_digest, record.state
    if written:
        closed = next((s for s in State if is_closed_as(record, s, written)), None)
        if closed is None:
            return "WRONG", f"there is a digest over all, though the run is {state}"
        return "unfinished", f"{written}, of a run that ended {closed} but for writing so"
    if expected:
        return "WRONG", "the run hasn't ended, so there is no digest to compare"
    if ended and not is_time(ended):
        return "WRONG", f"there is a time of the end, {ended!r}, though the run is {state}"
    return "note", "state, message and writer aren't protected before the run's end"


def is_closed_as(record: Record, state: State, digest: str) -> bool:
    """Return whether a digest is that over all, had the run ended in a state."""
    return state.has_ended and digest == record.compute_closing_digest(state)


def is_time(text: str) -> bool:
    """Return whether a text is an ISO time with its zone, as the end is noted."""
    try:
        return datetime.fromisoformat(text).tzinfo is not None
    except ValueError:
        return False


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
