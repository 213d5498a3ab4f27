"""Let one process at a time write a record, identify it, and tell whether it still runs."""

from __future__ import annotations

import fcntl
import json
import os
import socket
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


def describe_this_process() -> str:
    """Describe this process as the writer of a run's record, as JSON: host, number and start."""
    return json.dumps({"host": socket.gethostname(), "pid": os.getpid(), "start": _start("self")})


def is_alive(writer: str) -> bool:
    """Return whether the writer of a run's record still runs.

    `writer` is what describe_this_process() returned. A process on another host can't be checked,
    and counts as running.
    """
    described = json.loads(writer)
    if described["host"] != socket.gethostname():
        return True
    return _start(str(described["pid"])) == described["start"] is not None


def _start(process: str) -> str | None:
    """Return when the process that writes a run's record started; None if it has ended.

    The time is in clock ticks since boot. Number and start together identify a process, because
    numbers are reused.
    """
    try:
        status = Path("/proc", process, "stat").read_text()
    except OSError:
        return None
    fields = status.rpartition(")")[2].split()
    return None if fields[0] == "Z" else fields[19]


def _lock(handle: int) -> bool:
    # The lock belongs to the open file, not to the process. It covers one byte far beyond the
    # file's end, so that it doesn't interfere with HDF5's own locks.
    lock = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 2**62, 1, 0)
    try:
        fcntl.fcntl(handle, fcntl.F_OFD_SETLK, lock)
    except OSError:
        return False
    return True
