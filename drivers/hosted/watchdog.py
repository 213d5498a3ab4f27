"""Who ends a process that neither its parent nor itself can end."""

from __future__ import annotations

import os
import select
import signal

from drivers.hosted.message_socket import hang_up_poll


def start_watchdog(end: int, grace: float) -> None:
    """Make a process that kills this one if it doesn't end in time after its parent has.

    A thread couldn't: a library that hangs may hold the interpreter's lock. It is forked, so
    this is to be called before there are threads; and it is nobody's child, for a library
    that waits for its own children must not find it.
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
