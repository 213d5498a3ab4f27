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

from drivers.hosted.bootstrap import BOOTSTRAP_CODE, IGNORED_SIGNALS
from drivers.hosted.message_socket import LineClosed, MessageSocket, MessageTimeout

_EXIT_GRACE = 10.0
"""Seconds in which a process that was left alone must have made its device safe and ended."""

_KILL_TIMEOUT = 1.0
"""Seconds for which a kill waits for its effect: one stuck in the kernel stays for longer."""

_ROOT = str(Path(__file__).parents[2])
"""Where another Python finds this package."""


class ProcessEnded(Exception):
    """The process answers no more; how that came, in words."""


class ChildProcess:
    """A Python process that calls target(line, *given) and ends when that returns.

    target: "module:function". What it raises comes as a `CallResult`, asked or not. python: the
    command of another Python; that one has its own packages, and others only while it loads
    the target, from `folders`. memory: bytes of what both can map, see `MessageSocket`; it has no
    name, so that nothing is left behind, whoever is killed. grace: seconds that the process has
    when the line is closed, by `close` or because we are gone; its watchdog kills it then. errors:
    a descriptor for what it prints. Signals to a whole process group, as by Ctrl-C, don't end it.

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
        self._grace = _EXIT_GRACE if grace is None else grace
        ours, theirs = socket.socketpair()
        shared = os.memfd_create("labapp")
        os.ftruncate(shared, memory)
        self.line = MessageSocket(ours.detach(), shared)
        words = [str(theirs.fileno()), str(shared), str(self._grace), target]
        words += ["lent", _ROOT, *folders] if python else ["", *sys.path]
        # Blocked until the child ignores them: Ctrl-C must not find it half awake.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, IGNORED_SIGNALS)
        try:
            self._popen = subprocess.Popen(
                [*(python or [sys.executable]), "-c", BOOTSTRAP_CODE, *words],
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
        self.exit_descriptor = os.pidfd_open(self.pid)
        """A descriptor that can be read once it has ended."""
        self._open = True
        self.send(given)

    def send(self, message: object) -> None:
        """Send it. Whether the process has ended is told to whoever wants an answer."""
        with contextlib.suppress(OSError):
            self.line.send(message)

    def receive(self, timeout: float = math.inf, on_poll: Callable[[], None] | None = None) -> Any:
        """The next message. ProcessEnded if it hasn't come within so many seconds: it is killed
        then.

        on_poll: called every 20 ms meanwhile; what it raises comes from here.
        """
        try:
            return self.line.receive(timeout, on_poll, self.exit_descriptor)
        except MessageTimeout:
            self.kill()
            raise ProcessEnded(f"no answer within {timeout:g} s; its process was killed") from None
        except LineClosed:
            raise ProcessEnded(self._describe_exit()) from None

    def send_signal(self, number: int) -> None:
        self._popen.send_signal(number)

    def exit_code(self, timeout: float = 0.0) -> int | None:
        """Its exit status, waited for; None if it hasn't ended."""
        return reap(self._popen, timeout)

    def _describe_exit(self) -> str:
        """How it has ended. One that only has closed its line is killed."""
        code = self.exit_code(_KILL_TIMEOUT)
        if code is None:
            self.kill()
            code = self.exit_code()
        if code is None:
            return "its process was killed, but hangs in the system"
        how = f"exit status {code}" if code >= 0 else f"signal {-code}"
        return f"its process ended ({how})"

    def kill(self) -> None:
        """End it at once; from any thread, as often as you like."""
        self._popen.kill()
        self.exit_code(_KILL_TIMEOUT)

    def close(self) -> None:
        """Let it end by itself, now that nobody speaks with it, and kill it if it doesn't."""
        if not self._open:
            return
        self._open = False
        self.line.close()
        if self.exit_code(self._grace) is None:
            self.kill()
        os.close(self.exit_descriptor)


def reap(process: subprocess.Popen[Any], timeout: float) -> int | None:
    """The process's exit status; None if it hasn't ended after `timeout` seconds."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(timeout)
    return None


def terminate_or_kill(process: subprocess.Popen[Any], timeout: float) -> None:
    """End a program that isn't ours: it is told to, and is killed if it doesn't obey."""
    process.terminate()
    if reap(process, timeout) is None:
        process.kill()
        process.wait()
