"""What tests leave without a parent, adopted: reaped as init would, and ended with its worker."""

from __future__ import annotations

import ctypes
import os
import signal
from contextlib import suppress
from typing import Any

from runner.processes import end_descendants

_SET_CHILD_SUBREAPER = 36
"""Of prctl(2); from linux/prctl.h."""


class Orphans:
    """The processes below this one that belong to no living worker."""

    def __init__(self) -> None:
        self.workers: set[int] = set()
        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        signal.signal(signal.SIGCHLD, _reap)

    def end(self) -> None:
        end_descendants(os.getpid(), self.workers)

    def close(self) -> None:
        end_descendants(os.getpid())
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)


def _reap(*_: Any) -> None:
    """Let the dead go at once: a test may wait for a process to be there no more."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
