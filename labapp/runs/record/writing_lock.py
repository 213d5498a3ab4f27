"""Open a record for writing, which one process at a time may do."""

from __future__ import annotations

import fcntl
import os
import stat
import struct
from pathlib import Path

from labapp.common.errors import UserError


def open_for_writing(path: Path) -> int:
    """Open a run's record for writing; return its handle, which holds the lock until it's closed.

    Raises UserError if another process writes the record, or it isn't a plain file.
    """
    handle = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise UserError(f"{path}: isn't a plain file. Give the record of a run.")
    if not _lock(handle):
        os.close(handle)
        raise UserError(f"{path}: is being written by another process. Wait for it to end.")
    return handle


def is_being_written(path: Path) -> bool:
    """Return whether a process on this host holds the lock of a file, such as a run's record."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        return not _lock(handle)
    finally:
        os.close(handle)


def _lock(handle: int) -> bool:
    # The lock belongs to the open file, not to the process. It covers one byte far beyond the
    # file's end, so that it doesn't interfere with HDF5's own locks.
    lock = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 2**62, 1, 0)
    try:
        fcntl.fcntl(handle, fcntl.F_OFD_SETLK, lock)
    except OSError:
        return False
    return True
