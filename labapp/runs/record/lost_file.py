"""Find a file that was moved while it was written, or keep its frames if it was deleted."""

from __future__ import annotations

import os
from contextlib import suppress
from itertools import count
from pathlib import Path

from labapp.files.write_locks import has_path
from labapp.files.writing import sync_to_disk

_COPY_BYTES = 1 << 24
"""Bytes that are copied at once. Chosen: little beside a record, and enough for a disk's speed."""


def find_or_copy(handle: int, path: Path) -> Path:
    """Return where an open file is now: its path, or another after a move.

    A file that was deleted or replaced is copied to a free name beside its path. Raises OSError
    if the copy can't be written.
    """
    if has_path(handle, path):
        return path
    moved = Path(os.readlink(f"/proc/self/fd/{handle}"))
    return moved if has_path(handle, moved) else _copy(handle, path)


def _copy(handle: int, path: Path) -> Path:
    """Copy an open file to a free name beside its path, and return the name."""
    for number in count(1):
        copy = path.with_name(f"{path.stem}_rescued_{number}{path.suffix}")
        with suppress(FileExistsError), copy.open("xb") as file:
            while data := os.pread(handle, _COPY_BYTES, file.tell()):
                file.write(data)
            file.flush()
            sync_to_disk(copy, copy.parent)
            return copy
    raise AssertionError("one of the names is free")
