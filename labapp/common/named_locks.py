"""Locks of this computer by name, which need no file: each is held until its holder closes it.

A lock is a Unix socket with an abstract name (unix(7)). Such a name belongs to nobody's folder and
goes with its process: nothing stays behind that another user could lock something with, or couldn't
remove.
"""

from __future__ import annotations

import socket
import struct
from contextlib import suppress

_ANSWER_TIMEOUT = 0.5
"""Seconds within which the system must say who holds a lock. Chosen: it takes microseconds."""


def take_named_lock(name: str) -> socket.socket | None:
    """Take the lock of a name; None if somebody holds it. Closing what is returned releases it."""
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        lock.bind(f"\0{name}")
        lock.listen()
    except OSError:
        lock.close()
        return None
    return lock


def find_lock_holder(name: str) -> tuple[int, int] | None:
    """Return process and user that hold the lock of a name; None if nobody is known to hold it."""
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as question:
        question.settimeout(_ANSWER_TIMEOUT)
        question.connect(f"\0{name}")
        told = question.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        process, user, _ = struct.unpack("3i", told)
        return process, user
    return None
