"""Identify the process that writes a record, and tell whether it still runs."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path


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
        stat = Path("/proc", process, "stat").read_text()
    except OSError:
        return None
    fields = stat.rpartition(")")[2].split()
    return None if fields[0] == "Z" else fields[19]
