"""Let one process at a time write a record, identify it, and tell whether it still runs."""

from __future__ import annotations

import errno
import json
import logging
import os
import socket
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.write_locks import lock_limit, open_locked

log = logging.getLogger(__name__)

_WITHOUT_RIGHTS = "Copy it to where you may write"

_REMEDIES = {
    errno.ENOENT: "Check the path",
    errno.EISDIR: "Give the record of a run",
    errno.EACCES: _WITHOUT_RIGHTS,
    errno.EPERM: _WITHOUT_RIGHTS,
    errno.EROFS: _WITHOUT_RIGHTS,
}
"""What to do about errors of the system."""


def open_for_writing(path: Path) -> int:
    """Open a record for writing; return its handle, which holds the lock until it's closed.

    Raises UserError if another process writes it, or it isn't a file that may be written.
    """
    try:
        handle = open_locked(path)
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "Copy it to another disk")
        raise UserError(
            f"{path}: can't be opened for writing: {error.strerror}. {remedy}."
        ) from error
    warn_of_lock(path, handle)
    return handle


def warn_of_lock(path: Path, handle: int) -> None:
    """Name in the log what a file's lock can't promise, where there is something."""
    if limit := lock_limit(handle):
        log.warning("%s: %s", path, limit)


def describe_this_process() -> str:
    """Describe this process as a writer, in JSON: host, number and start."""
    return json.dumps({"host": socket.gethostname(), "pid": os.getpid(), "start": _start("self")})


def is_alive(writer: str) -> bool:
    """Return whether a writer still runs.

    A process on another host can't be checked, and counts as running; one whose description is torn
    is gone.

    writer: what describe_this_process() returned.
    """
    try:
        described = json.loads(writer)
    except ValueError:
        return False
    if described["host"] != socket.gethostname():
        return True
    return _start(str(described["pid"])) == described["start"] is not None


def _start(process: str) -> str | None:
    """Return when a process started, in clock ticks since boot; None if it has ended.

    Number and start together identify a process, because numbers are reused.
    """
    try:
        status = Path("/proc", process, "stat").read_text()
    except OSError:
        return None
    fields = status.rpartition(")")[2].split()
    return None if fields[0] == "Z" else fields[19]
