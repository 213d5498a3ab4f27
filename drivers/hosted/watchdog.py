"""Kill a child process that doesn't end after its parent."""

from __future__ import annotations

import os
import select
import signal

from drivers.hosted.message_socket import hang_up_poll


def start_watchdog(end: int, grace: float) -> None:
    """Fork a process that kills this child process if it doesn't end after its parent.

    A thread couldn't do this, because a library that hangs may hold the interpreter's lock. The
    watchdog is forked, so this function must be called before threads are started. It is forked
    twice, so that it isn't a child of this process: a library that waits for its own children must
    not find it. end: descriptor of the socket to the parent. grace: seconds after its closing.
    """
    guarded = os.pidfd_open(os.getpid())
    between = os.fork()
    if between:
        os.close(guarded)
        os.waitpid(between, 0)
        return
    try:
        if not os.fork():
            _kill_after_grace(guarded, end, grace)
    finally:
        os._exit(0)


def _kill_after_grace(guarded: int, end: int, grace: float) -> None:
    either = hang_up_poll(end)
    either.register(guarded, select.POLLIN)
    either.poll()
    if not select.select([guarded], [], [], grace)[0]:
        signal.pidfd_send_signal(guarded, signal.SIGKILL)
