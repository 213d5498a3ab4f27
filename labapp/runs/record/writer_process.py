"""Whether the process that writes a file is still there."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path


def describe_this_process() -> str:
    """This process, as JSON: host, number, and when it started."""
    return json.dumps({"host": socket.gethostname(), "pid": os.getpid(), "start": _start("self")})


def is_alive(writer: str) -> bool:
    """Whether a process described by describe_this_process() still runs.

    On another host nobody can tell, and it counts as running.
    """
    described = json.loads(writer)
    if described["host"] != socket.gethostname():
        return True
    return _start(str(described["pid"])) == described["start"] is not None


def _start(process: str) -> str | None:
    """When a process started, in clock ticks since boot; None if there is none.

    A process number is used again; with its start it isn't.
    """
    try:
        stat = Path("/proc", process, "stat").read_text()
    except OSError:
        return None
    fields = stat.rpartition(")")[2].split()
    return None if fields[0] == "Z" else fields[19]
