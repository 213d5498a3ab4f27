"""Lists of frames as people write and read them: 0-9,12."""

from __future__ import annotations

import re
from collections.abc import Iterable

from labapp.common.errors import UserError

_PART = re.compile(r"(\d+)(?:-(\d+))?", re.ASCII)

_MAX_LISTED_RANGES = 12
"""Ranges that are written out; what comes after them is counted."""


def read_frame_list(text: str, frames: int) -> list[int]:
    """The indices of a list such as "0-9,12", rising, each once.

    UserError if it isn't such a list, or names a frame beyond the record's `frames`.
    """
    found: set[int] = set()
    for part in text.split(","):
        match = _PART.fullmatch(part.strip())
        if match is None:
            raise UserError(f"--frames: {part.strip()!r} is no frame. Write 0-9,12 for example.")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise UserError(f"--frames: {first}-{last} runs backwards. Write {last}-{first}.")
        if last >= frames:
            raise UserError(f"--frames: there is no frame {last}; the record has 0-{frames - 1}.")
        found.update(range(first, last + 1))
    return sorted(found)


def format_frame_list(frames: Iterable[int]) -> str:
    """Indices as a short list, "0-9, 12"; of very many ranges the first, and a count."""
    ranges: list[tuple[int, int]] = []
    for index in sorted(set(frames)):
        if ranges and index == ranges[-1][1] + 1:
            ranges[-1] = ranges[-1][0], index
        else:
            ranges.append((index, index))
    shown = ", ".join(f"{a}-{b}" if b > a else f"{a}" for a, b in ranges[:_MAX_LISTED_RANGES])
    more = sum(b - a + 1 for a, b in ranges[_MAX_LISTED_RANGES:])
    return f"{shown} and {more} more" if more else shown
