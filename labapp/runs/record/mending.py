"""Mend what stands before a record's log from its copy, where something proves the copy right.

What was known before the first frame has the digest of the structure. A link has the one before it,
a frame's settings have the digest in its link, and what the end of a run wrote has the closing
digest. Before that end, state and writer have no digest: they must only be such as are written.
A power cut may take any of the file's last pages; state and log are mended after it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.record import layout
from labapp.runs.record.chain import (
    AT_ONCE,
    FrameChain,
    LogChain,
    follow_frames,
    follow_log,
    merge_copies,
)
from labapp.runs.record.digest_checks import is_time
from labapp.runs.record.digests import (
    ENDING,
    SETTINGS,
    closing_digest,
    is_structure_proved,
    line_digest,
    structure_digest,
)
from labapp.runs.record.place_table import PlaceTable, TableError, write_all
from labapp.runs.record.second_copy import Copy, find_copy, read_both, renew_copy
from labapp.runs.state import State

_STRUCTURE, _CHAIN = (f"{layout.DIGESTS}/{name}" for name in ("structure", "chain"))

_CLOSING = f"{layout.DIGESTS}/closing"

_STORED = f"{layout.DATA}/stored"


@dataclass(frozen=True)
class _Record:
    """A record that is mended.

    copy: what it is mended from.
    """

    handle: int
    table: PlaceTable
    copy: Copy

    def blocks(self, *, copied: bool = False) -> Iterator[NDArray[Any]]:
        """Yield the rows of the chain, or of its copy."""
        place = self.table.places[_CHAIN]
        table = PlaceTable(self.table.size, {_CHAIN: self.copy.of(place) if copied else place})
        return table.read_blocks(self.handle, _CHAIN, AT_ONCE)

    def chain(self) -> FrameChain:
        frames = self.table.places[_STORED].shape[0]
        return follow_frames(self.blocks(), self.structure(), frames)

    def structure(self) -> bytes:
        return self.table.read(self.handle, _STRUCTURE).tobytes()

    def both(self, name: str) -> list[NDArray[Any]]:
        """Return a dataset and its copy; raise TableError if one is cut off."""
        found = read_both(self.handle, self.table, name)
        if len(found) < 2:
            raise TableError(f"the copy of {name} is cut off")
        return found

    def write(self, name: str, data: bytes, row: int = 0) -> None:
        self.table.write(self.handle, name, data, row)


def mend_from_copy(handle: int, table: PlaceTable) -> list[str]:
    """Mend what stands before the log from its copy; return what was mended, in words."""
    copy = find_copy(table)
    if copy is None:
        return []
    record = _Record(handle, table, copy)
    done = []
    with suppress(TableError):
        done += ["what was known before the first frame"] * _mend_fixed(record)
        if is_structure_proved(handle, table):
            done += ["digests of the frames"] * _mend_chain(record)
            chain = record.chain()
            done += ["settings of the frames"] * _mend_settings(record, chain)
            done += ["marks of stored frames"] * _mend_marks(record, chain)
            done += ["state and end of the run"] * _mend_ending(record, chain)
    return [f"mended from the record's own copy: {', '.join(done)}"] if done else []


def renew_proved_copy(handle: int, table: PlaceTable) -> list[str]:
    """Write the copy anew if what it is of is proved; return that in words."""
    copy = find_copy(table)
    if copy is None:
        return []
    record = _Record(handle, table, copy)
    if not is_structure_proved(handle, table) or record.chain().broken is not None:
        return []
    return ["written anew: the copy at the record's end"] if renew_copy(handle, table) else []


def _mend_fixed(record: _Record) -> bool:
    """Mend what never changes, and its digest; return whether something was."""
    handle, table = record.handle, record.table
    front, second = (one.tobytes() for one in record.both(_STRUCTURE))
    own = structure_digest(handle, table)
    if own == front:
        return False
    if own != second:
        own = structure_digest(handle, table, copied=record.copy.begin)
        if own not in (front, second):
            return False
        _take_fixed(record)
    record.write(_STRUCTURE, own)
    return True


def _take_fixed(record: _Record) -> None:
    """Write the copy over all that never changes."""
    changing = sorted(
        (place.offset, place.end)
        for name, place in record.table.places.items()
        if name in layout.CHANGING and record.copy.has(place)
    )
    position = 0
    for begin, end in (*changing, (record.copy.size, record.copy.size)):
        if position < begin:
            data = os.pread(record.handle, begin - position, record.copy.begin + position)
            write_all(record.handle, memoryview(data), position)
        position = max(position, end)


def _mend_chain(record: _Record) -> bool:
    """Mend links that the copy has as they follow; return whether there were any."""
    structure = record.structure()
    merged = merge_copies(record.blocks(), record.blocks(copied=True), structure)
    mended = False
    for number, (rows, own) in enumerate(zip(merged, record.blocks(), strict=True)):
        if rows.tobytes() != own.tobytes():
            record.write(_CHAIN, rows.tobytes(), number * AT_ONCE)
            mended = True
    return mended


def _mend_settings(record: _Record, chain: FrameChain) -> bool:
    """Mend measured columns by what the frames' links tell, and by zeros for others.

    Returns whether something was mended.
    """
    mended = False
    for name, values in linked_columns(record.blocks(), chain).items():
        own, second = record.both(f"{layout.DATA}/{name}")
        bits = np.dtype(f"u{own.itemsize}")
        right = np.where(chain.linked, values.view(bits), own.view(bits))
        # What was never taken has nothing, unless its writer was killed.
        right[~chain.linked & (second.view(bits) == 0)] = 0
        if right.tobytes() != own.tobytes():
            record.write(f"{layout.DATA}/{name}", right.tobytes())
            mended = True
    return mended


def linked_columns(blocks: Iterator[NDArray[Any]], chain: FrameChain) -> dict[str, NDArray[Any]]:
    """Return the measured columns by the frames' latest links; zeros for others."""
    values = np.zeros((len(chain.latest), *layout.VALUES.shape), np.uint8)
    for number, rows in enumerate(blocks):
        first = number * AT_ONCE
        here = np.flatnonzero((chain.latest >= first) & (chain.latest < first + len(rows)))
        values[here] = rows["values"][chain.latest[here] - first]
    found, at = {}, 0
    for name in SETTINGS:
        kind = layout.MEASURED[name]
        part = np.ascontiguousarray(values[:, at : at + kind.itemsize])
        found[name], at = part.view(kind)[:, 0], at + kind.itemsize
    return found


def _mend_marks(record: _Record, chain: FrameChain) -> bool:
    """Mend the marks of stored frames; return whether something was mended."""
    own, second = record.both(_STORED)
    right = np.where(own > 1, np.minimum(second, 1), own)
    right = np.where(chain.linked, np.maximum(right, second == 1), np.minimum(right, second))
    if right.tobytes() == own.tobytes():
        return False
    record.write(_STORED, right.astype(own.dtype).tobytes())
    return True


def _mend_ending(record: _Record, chain: FrameChain) -> bool:
    """Mend what the end of the run wrote; return whether something was mended."""
    structure = record.structure()
    log = record.table.read_blocks(record.handle, f"{layout.ENTRY}/log", AT_ONCE)
    lines = follow_log(log, structure)
    names = [*(f"{layout.ENTRY}/{name}" for name in ENDING), _CLOSING]
    own, second = ({n: record.both(n)[k].tobytes() for n in names} for k in (0, 1))

    def is_proved(values: Mapping[str, bytes]) -> bool:
        ending = [values[name] for name in names[:-1]]
        return values[_CLOSING] == closing_digest(
            structure, chain.length, chain.last, lines.length, lines.last, ending
        )

    if is_proved(own) or own == second:
        return False
    odd = {name for name, is_written in _WRITTEN.items() if not is_written(own[name])}
    lost = names if is_proved(second) else [n for n in odd if _WRITTEN[n](second[n])]
    for name in lost:
        record.write(name, second[name])
    return bool(lost)


def _is_writer(data: bytes) -> bool:
    try:
        return {"host", "pid", "start"} <= json.loads(data.rstrip(b"\0")).keys()
    except (ValueError, AttributeError):
        return False


def _is_end_time(data: bytes) -> bool:
    return not any(data) or is_time(data.rstrip(b"\0").decode(errors="replace"))


_WRITTEN: dict[str, Callable[[bytes], bool]] = {
    f"{layout.ENTRY}/state": lambda data: state_of(data) is not None,
    f"{layout.ENTRY}/writer": _is_writer,
    f"{layout.ENTRY}/end_time": _is_end_time,
    f"{layout.ENTRY}/log_lost": lambda data: not any(data),
    _CLOSING: lambda data: not any(data),
}
"""Tell of what an unfinished record has no digest for whether it is such as is written."""


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
