"""A process that is started from here: called, waited for, and ended."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from drivers.hosted.child import BOOT, IGNORED
from drivers.hosted.line import Closed, Late, Line

_GRACE = 10.0
"""Seconds in which a process that was left alone must have made its device safe and ended."""

_KILLING = 1.0
"""Seconds for which a kill waits for its effect: one stuck in the kernel stays for longer."""

_ROOT = str(Path(__file__).parents[2])
"""Where another Python finds this package."""


class Ended(Exception):
    """The process answers no more; how that came, in words."""


class Process:
    """A Python process that calls target(line, *given) and ends when that returns.

    target: "module:function". What it raises comes as an `Answer`, asked or not. python: the
    command of another Python; that one has its own packages, and others only while it loads
    the target, from `folders`. memory: bytes of what both can map, see `Line`; it has no name,
    so that nothing is left behind, whoever is killed. grace: seconds that the process has when
    the line is closed, by `close` or because we are gone; its guard kills it then. errors: a
    descriptor for what it prints. Signals to a whole process group, as by Ctrl-C, don't end it.

    OSError if there is no such Python.
    """

    def __init__(
        self,
        target: str,
        *given: Any,
        python: Sequence[str] = (),
        folders: Sequence[str] = (),
        memory: int = 0,
        grace: float | None = None,
        errors: int = 2,
    ) -> None:
        self._grace = _GRACE if grace is None else grace
        ours, theirs = socket.socketpair()
        shared = os.memfd_create("labapp")
        os.ftruncate(shared, memory)
        self.line = Line(ours.detach(), shared)
        words = [str(theirs.fileno()), str(shared), str(self._grace), target]
        words += ["lent", _ROOT, *folders] if python else ["", *sys.path]
        # Blocked until the child ignores them: Ctrl-C must not find it half awake.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, IGNORED)
        try:
            self._popen = subprocess.Popen(
                [*(python or [sys.executable]), "-c", BOOT, *words],
                stdin=subprocess.DEVNULL,
                stdout=errors,
                stderr=errors,
                pass_fds=(theirs.fileno(), shared),
            )
        except BaseException:
            self.line.close()
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()
        self.pid = self._popen.pid
        self.ended = os.pidfd_open(self.pid)
        """A descriptor that can be read once it has ended."""
        self._open = True
        self.tell(given)

    def tell(self, message: object) -> None:
        """Send it. Whether the process has ended is told to whoever wants an answer."""
        with contextlib.suppress(OSError):
            self.line.send(message)

    def next(self, within: float = math.inf, look: Callable[[], None] | None = None) -> Any:
        """The next message. Ended if it hasn't come within so many seconds: it is killed then.

        look: called every 20 ms meanwhile; what it raises comes from here.
        """
        try:
            return self.line.receive(within, look, self.ended)
        except Late:
            self.kill()
            raise Ended(f"no answer within {within:g} s; its process was killed") from None
        except Closed:
            raise Ended(self._end_in_words()) from None

    def send_signal(self, number: int) -> None:
        self._popen.send_signal(number)

    def code(self, patience: float = 0.0) -> int | None:
        """Its exit status, waited for; None if it hasn't ended."""
        return reap(self._popen, patience)

    def _end_in_words(self) -> str:
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
