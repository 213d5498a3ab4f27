"""Lists of frame numbers as text, such as "0-9,12"."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from labapp.common.errors import UserError

_PART = re.compile(r"(\d+)(?:-(\d+))?", re.ASCII)


def read_frame_list(text: str, frames: int) -> list[int]:
    """Parse a list of frame indices below `frames`, such as "0-9,12"; sorted, each index once.

    Raises UserError if the text isn't such a list, or names a frame beyond the last one.
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
    """Format frame indices as in "0-9, 12"; after 12 ranges, others are only counted."""
    listed = np.unique(np.fromiter(frames, np.int64))
    begins = np.flatnonzero(np.diff(listed, prepend=-2) != 1)
    ends = np.append(begins[1:], len(listed))
    ranges = [(listed[a], listed[b - 1]) for a, b in zip(begins[:12], ends, strict=False)]
    shown = ", ".join(f"{a}-{b}" if b > a else f"{a}" for a, b in ranges)
    more = len(listed) - begins[12] if len(begins) > 12 else 0
    return f"{shown} and {more} more" if more else shown
