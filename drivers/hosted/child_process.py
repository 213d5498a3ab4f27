"""Start, call, await and end child processes."""

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
"""Seconds in which a child process must make its device safe and end after its line was closed."""

_KILL_TIMEOUT = 1.0
"""Seconds for which a kill waits for the process to end; one stuck in the kernel takes longer."""

_ROOT = str(Path(__file__).parents[2])
"""Folder in which another Python finds the package `drivers`."""


class ProcessEnded(Exception):
    """Raised when a child process no longer answers; the message says why."""


class ChildProcess:
    """Start a Python process that calls target(line, *given) and then ends.

    target: "module:function". An exception of the target comes as a `CallResult`, even if no
    request is pending. python: command of another Python, which has its own packages; it finds
    those in `folders` only while it loads the target. memory: size of the shared memory in bytes,
    see `MessageSocket`. It has no name, so that nothing remains when a process is killed. grace:
    seconds that the child has to end after the line was closed, by `close` or because this process
    has ended; the watchdog then kills it. errors: descriptor for the child's output. Signals to the
    whole process group, for example by Ctrl-C, don't end the child; in a session of its own, not
    even SIGKILL to the group does.

    Raises OSError if there is no such Python.
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
        own_session: bool = False,
    ) -> None:
        self._grace = _EXIT_GRACE if grace is None else grace
        ours, theirs = socket.socketpair()
        shared = os.memfd_create("labapp")
        os.ftruncate(shared, memory)
        self.line = MessageSocket(ours.detach(), shared)
        words = [str(theirs.fileno()), str(shared), str(self._grace), target]
        words += ["lent", _ROOT, *folders] if python else ["", *sys.path]
        # The signals stay blocked until the child ignores them, so that Ctrl-C can't end it while
        # it starts.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, IGNORED_SIGNALS)
        try:
            self._popen = subprocess.Popen(
                [*(python or [sys.executable]), "-c", BOOTSTRAP_CODE, *words],
                stdin=subprocess.DEVNULL,
                stdout=errors,
                stderr=errors,
                pass_fds=(theirs.fileno(), shared),
                start_new_session=own_session,
            )
        except BaseException:
            self.line.close()
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()
        self.pid = self._popen.pid
        self.exit_descriptor = os.pidfd_open(self.pid)
        """Descriptor that becomes readable when the child has ended."""
        self._open = True
        self.send(given)

    def send(self, message: object) -> None:
        """Send a message; if the child has ended, only `receive` reports that."""
        with contextlib.suppress(OSError):
            self.line.send(message)

    def receive(self, timeout: float = math.inf, on_poll: Callable[[], None] | None = None) -> Any:
        """Return the child's next message, or raise ProcessEnded.

        A child that sends none within `timeout` seconds is killed. on_poll: called every 20 ms
        meanwhile; its exceptions pass through.
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
        """Wait for the exit status and return it, or None after `timeout` seconds."""
        return reap(self._popen, timeout)

    def _describe_exit(self) -> str:
        """Describe how the child ended; one that only closed its line is killed."""
        code = self.exit_code(_KILL_TIMEOUT)
        if code is None:
            self.kill()
            code = self.exit_code()
        if code is None:
            return "its process was killed, but hangs in the system"
        how = f"exit status {code}" if code >= 0 else f"signal {-code}"
        return f"its process ended ({how})"

    def kill(self) -> None:
        """Kill the child at once; any thread may call it, also repeatedly."""
        self._popen.kill()
        self.exit_code(_KILL_TIMEOUT)

    def close(self) -> None:
        """Close the line, so that the child ends by itself; kill it if it doesn't."""
        if not self._open:
            return
        self._open = False
        self.line.close()
        if self.exit_code(self._grace) is None:
            self.kill()
        os.close(self.exit_descriptor)


def reap(process: subprocess.Popen[Any], timeout: float) -> int | None:
    """Return the exit status, or None if the process hasn't ended after `timeout` seconds."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(timeout)
    return None


def terminate_or_kill(process: subprocess.Popen[Any], timeout: float) -> None:
    """Terminate a process that runs a foreign program; kill it after `timeout` seconds."""
    process.terminate()
    if reap(process, timeout) is None:
        process.kill()
        process.wait()
