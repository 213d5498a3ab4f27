"""Follow the chains of a record: of its frames and of its log, link by link."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.record.digests import first_line, first_link, line_digest, link_digest


@dataclass
class FrameChain:
    """The links of a record's frames.

    rows: all, of the type CHAIN_ROW. length: links that follow from each other. last: digest of the
    last one. latest: row of each frame's latest link. broken: row of the first link that doesn't
    follow; None if all do.
    """

    rows: NDArray[Any]
    length: int
    last: bytes
    latest: dict[int, int] = field(default_factory=dict)
    broken: int | None = None


@dataclass(frozen=True)
class LogChain:
    """The lines of a record's log: see FrameChain."""

    length: int
    last: bytes
    broken: int | None = None


def follow_frames(rows: NDArray[Any], structure: bytes) -> FrameChain:
    """Follow the links of a record's frames from the first on.

    rows: of the type CHAIN_ROW. structure: digest of the record's structure. Rows of zeros before
    the last link are broken links.
    """
    used, found = _count_used(rows), FrameChain(rows, 0, first_link(structure))
    for number, row in enumerate(rows[:used]):
        if not follows(row, found.last):
            found.broken = number
            return found
        found.latest[int(row["frame"])] = number
        found.length, found.last = number + 1, row["link"].tobytes()
    return found


def follows(row: np.void, before: bytes) -> bool:
    """Return whether a link of a record's frame follows from the digest of the one before."""
    digest = link_digest(before, row["frame"], row["image"].tobytes(), row["settings"].tobytes())
    return bool(digest == row["link"].tobytes())


def follow_log(rows: NDArray[Any], structure: bytes) -> LogChain:
    """Follow the lines of a record's log from the first on; rows are of the type LOG_ROW."""
    before, used = first_line(structure), _count_used(rows)
    for number, row in enumerate(rows[:used]):
        line = line_digest(before, row["time"], bytes(row["text"]))
        if line != row["digest"].tobytes():
            return LogChain(number, before, number)
        before = line
    return LogChain(used, before)


def _count_used(rows: NDArray[Any]) -> int:
    """Return how many rows there are up to the last that isn't all zeros."""
    flat = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)
    used = np.flatnonzero(flat.any(axis=1))
    return int(used[-1]) + 1 if len(used) else 0
