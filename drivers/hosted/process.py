"""A process that is started from here: called, waited for, and ended."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from drivers.hosted.child import BOOT, IGNORED
from drivers.hosted.line import Line

_GRACE = 10.0
"""Seconds in which a process that was left alone must have made its device safe and ended."""

_KILLING = 1.0
"""Seconds for which a kill waits for its effect: one stuck in the kernel stays for longer."""

_LOOK = 0.02
"""Seconds between looks at what else may happen while an answer is waited for."""

_ROOT = str(Path(__file__).parents[2])
"""Where another Python finds this package."""


class Ended(Exception):
    """The process answers no more: see `Process.end_in_words`."""


class Late(Exception):
    """It didn't answer in time."""


class Process:
    """A Python process that calls target(line, *given) and ends when that returns.

    target: "module:function". line: the way to it, which it has the other end of; once this
    one is closed, because of `close` or because we are gone, it has `grace` seconds before
    its guard kills it. python: the command of another Python; it has the standard library and
    its own packages, but for what it imports from `folders` while it loads the target.
    passed: descriptors that it gets under the same numbers. errors: descriptor of what it
    prints. Signals to a whole process group, as by Ctrl-C, don't end it.

    OSError if there is no such Python.
    """

    def __init__(
        self,
        target: str,
        *given: Any,
        python: Sequence[str] = (),
        folders: Sequence[str] = (),
        passed: Sequence[int] = (),
        grace: float | None = None,
        errors: int = 2,
    ) -> None:
        self._grace = _GRACE if grace is None else grace
        ours, theirs = socket.socketpair()
        words = [str(theirs.fileno()), str(self._grace), target]
        if python:
            words += ["lent", _ROOT, *folders]
        else:
            words += ["", *sys.path]
        # Blocked until the child ignores them: Ctrl-C must not find it half awake.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, IGNORED)
        try:
            self._popen = subprocess.Popen(
                [*(python or [sys.executable]), "-c", BOOT, *words],
                stdin=subprocess.DEVNULL,
                stdout=errors,
                stderr=errors,
                pass_fds=(theirs.fileno(), *passed),
            )
        except BaseException:
            ours.close()
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()
        self.pid = self._popen.pid
        self.ended = os.pidfd_open(self.pid)
        """A descriptor that can be read once it has ended."""
        self._open = True
        self.line = Line(ours.detach())
        # It may have ended already; whoever asks it next is told.
        with contextlib.suppress(OSError):
            self.line.send(given)

    def next(self, within: float = math.inf, look: Callable[[], None] | None = None) -> Any:
        """The next message from it. Late if there is none within so many seconds; or Ended.

        look: called every 20 ms meanwhile; what it raises comes from here.
        """
        late = time.monotonic() + within
        while True:
            if look is not None:
                look()
            left = max(0.0, late - time.monotonic())
            patience = left if look is None else min(left, _LOOK)
            ready = wait([self.line, self.ended], None if patience == math.inf else patience)
            if ready and (message := self._taken()) is not None:
                return message
            # One of its own processes may still hold the socket open.
            if self.ended in ready:
                raise Ended
            if time.monotonic() >= late:
                raise Late

    def _taken(self) -> Any:
        try:
            return self.line.take()
        except (EOFError, OSError):
            raise Ended from None

    def send_signal(self, number: int) -> None:
        self._popen.send_signal(number)

    def code(self, patience: float = 0.0) -> int | None:
        """Its exit status, waited for; None if it hasn't ended."""
        return reap(self._popen, patience)

    def end_in_words(self) -> str:
        """How it has ended. One that only has closed its line is killed."""
        code = self.code(_KILLING)
        if code is None:
            self.kill()
            code = self.code()
        if code is None:
            return "its process was killed, but hangs in the system"
        how = f"exit status {code}" if code >= 0 else f"signal {-code}"
        return f"its process ended ({how})"

    def kill(self) -> None:
        """End it at once; from any thread, as often as you like."""
        self._popen.kill()
        self.code(_KILLING)

    def close(self) -> None:
        """Let it end by itself, now that nobody speaks with it, and kill it if it doesn't."""
        if not self._open:
            return
        self._open = False
        self.line.close()
        if self.code(self._grace) is None:
            self.kill()
        os.close(self.ended)


def reap(process: subprocess.Popen[Any], patience: float) -> int | None:
    """The process's exit status; None if it hasn't ended after `patience` seconds."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(patience)
    return None


def stop(process: subprocess.Popen[Any], patience: float) -> None:
    """End a program that isn't ours: it is told to, and is killed if it doesn't obey."""
    process.terminate()
    if reap(process, patience) is None:
        process.kill()
        process.wait()
