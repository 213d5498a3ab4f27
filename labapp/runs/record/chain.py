"""Follow the chains that protect frames and log, link by link."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.record import layout
from labapp.runs.record.digests import first_line, first_link, next_digest

AT_ONCE = 1 << 11
"""Rows of a chain that are in memory at once: half a megabyte. Chosen."""

_SETTINGS, _LINK = (layout.CHAIN_ROW.fields[name][1] for name in ("settings", "link"))  # type: ignore[index]
_VALUES = layout.LINK_ROW.itemsize
_TEXT, _DIGEST = (layout.LOG_ROW.fields[name][1] for name in ("text", "digest"))  # type: ignore[index]
"""Where parts of the rows begin, in bytes."""


@dataclass
class FrameChain:
    """The links of the frames, as far as they follow from each other.

    length: number of links that follow.
    last: digest of the last one.
    latest: row of each planned frame's latest link, -1 where it has none.
    beyond: frames with a link that aren't planned.
    broken: row of the first link that doesn't follow; None if all do.
    """

    length: int
    last: bytes
    latest: NDArray[np.int64]
    beyond: set[int]
    broken: int | None = None

    @property
    def linked(self) -> NDArray[np.bool_]:
        """Which of the planned frames have a link."""
        return self.latest >= 0


@dataclass(frozen=True)
class LogChain:
    """The lines of the log, as far as they follow from each other: see FrameChain."""

    length: int
    last: bytes
    broken: int | None = None


def follow_frames(blocks: Iterable[NDArray[Any]], structure: bytes, count: int) -> FrameChain:
    """Follow the links of the frames from the first on.

    Rows of zeros before the last link are broken links.

    blocks: all rows in their order, of the type CHAIN_ROW, or LINK_ROW in older records.
    structure: digest of the record's structure.
    count: number of the planned frames.
    """
    found = FrameChain(0, first_link(structure), np.full(count, -1, np.int64), set())
    for rows in _used(blocks):
        begin = found.length
        has_values = "values" in (rows.dtype.names or ())
        for row in _bytes_of(rows, layout.CHAIN_ROW if has_values else layout.LINK_ROW):
            if not _follows(row, found.last):
                found.broken = found.length
                break
            found.length, found.last = found.length + 1, row[_LINK:_VALUES]
        frames = rows["frame"][: found.length - begin]
        is_planned = frames < count
        found.beyond |= set(frames[~is_planned].tolist())
        # Of a frame that comes twice, the last row counts.
        found.latest[frames[is_planned]] = begin + np.flatnonzero(is_planned)
        if found.broken is not None:
            break
    return found


def follows(row: np.void, before: bytes) -> bool:
    """Return whether a frame's link follows from the digest of the one before."""
    return _follows(row.tobytes(), before)


def _follows(row: bytes, before: bytes) -> bool:
    """Return whether a row's link follows from the one before, and its settings have its digest."""
    linked = next_digest(before, row[:_LINK]) == row[_LINK:_VALUES]
    values = row[_VALUES:]
    return linked and (not values or sha256(values).digest() == row[_SETTINGS:_LINK])


def merge_copies(
    blocks: Iterable[NDArray[Any]], copied: Iterable[NDArray[Any]], structure: bytes
) -> Iterator[NDArray[Any]]:
    """Yield the rows of the frames' chain, each as it is in whichever of two copies it follows."""
    before = first_link(structure)
    for front, second in zip(blocks, copied, strict=True):
        merged = front
        for n in _differing(front, second):
            merged = front.copy() if merged is front else merged
            link = merged[n - 1]["link"].tobytes() if n else before
            if not follows(front[n], link) and (
                follows(second[n], link) or _has_settings(second[n]) > _has_settings(front[n])
            ):
                merged[n] = second[n]
        before = merged[-1]["link"].tobytes()
        yield merged


def _has_settings(row: np.void) -> bool:
    """Return whether a row has the settings of which it has the digest."""
    return sha256(row["values"].tobytes()).digest() == row["settings"].tobytes()


def _differing(front: NDArray[Any], second: NDArray[Any]) -> list[int]:
    """Return the rows in which two copies of a chain differ."""
    kind = (np.uint8, front.dtype.itemsize)
    both = [np.ascontiguousarray(one).view(kind) for one in (front, second)]
    found: list[int] = np.flatnonzero((both[0] != both[1]).any(axis=1)).tolist()
    return found


def follow_log(blocks: Iterable[NDArray[Any]], structure: bytes) -> LogChain:
    """Follow the lines of the log from the first on.

    blocks: all rows in their order, of the type LOG_ROW.
    """
    before, length = first_line(structure), 0
    for rows in _used(blocks):
        for row in _bytes_of(rows, layout.LOG_ROW):
            line = next_digest(before, row[:_TEXT] + row[_TEXT:_DIGEST].rstrip(b"\0"))
            if line != row[_DIGEST:]:
                return LogChain(length, before, length)
            before, length = line, length + 1
    return LogChain(length, before)


def _bytes_of(rows: NDArray[Any], kind: np.dtype) -> Iterator[bytes]:
    data = rows.astype(kind, copy=False).tobytes()
    return (data[at : at + kind.itemsize] for at in range(0, len(data), kind.itemsize))


def _used(blocks: Iterable[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    """Yield the rows of a chain, in blocks, up to the last that isn't all zeros."""
    held: list[NDArray[Any]] = []
    for rows in blocks:
        flat = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)
        used = np.flatnonzero(flat.any(axis=1))
        if not len(used):
            # Zeros count only if something comes after them; then one row stands for them.
            held = held or [rows[:1]]
            continue
        yield from held
        held = []
        end = int(used[-1]) + 1
        yield rows[:end]
        held = [rows[end : end + 1]] if end < len(rows) else []
