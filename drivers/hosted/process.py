"""A device's process, as its parent sees it: how it is started and how it is ended."""

from __future__ import annotations

import contextlib
import mmap
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable

from drivers.hosted.channel import Channel

_GRACE = 10.0
"""Seconds in which a process that was left alone must have made its device safe and ended."""

KILLING = 1.0
"""Seconds for which a kill waits for its effect: one stuck in the kernel stays for longer."""

IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""They reach a whole process group; a device's process ends by itself, after its parent."""

_CHILD = (
    "import sys; sys.path[:] = sys.argv[4:]; "
    "from drivers.hosted.serving import serve; serve(*sys.argv[1:4])"
)


def start() -> tuple[Channel, subprocess.Popen[bytes]]:
    """A device's process that has not been told yet which."""
    memory = os.memfd_create("labapp-device")
    os.ftruncate(memory, mmap.PAGESIZE)

    def command(end: int) -> list[str]:
        given = [str(number) for number in (end, memory, _GRACE)]
        python = [sys.executable, "-u", "-X", "faulthandler", "-c", _CHILD]
        return [*python, *given, *sys.path]

    kept = os.dup(memory)
    try:
        ours, process = spawn(command, memory)
    except BaseException:
        os.close(kept)
        raise
    return Channel(ours, kept), process


def spawn(command: Callable[[int], list[str]], memory: int) -> tuple[int, subprocess.Popen[bytes]]:
    """A process and our end of a socket to it; its memory's descriptor is closed here.

    command: what is run, told the number of the process's own end.
    """
    ours, theirs = socket.socketpair()
    # Blocked until the child ignores them: Ctrl-C must not find it half awake.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, IGNORED)
    try:
        process = subprocess.Popen(
            command(theirs.fileno()),
            stdin=subprocess.DEVNULL,
            stdout=2,
            pass_fds=(theirs.fileno(), memory),
        )
    except BaseException:
        ours.close()
        raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        os.close(memory)
    return ours.detach(), process


def close(channel: Channel, process: subprocess.Popen[bytes], ended: int) -> None:
    """Let the process end, which makes its device safe first if it was never left."""
    channel.close()
    if reap(process, _GRACE) is None:
        process.kill()
        reap(process, KILLING)
    os.close(ended)


def reap(process: subprocess.Popen[bytes], patience: float) -> int | None:
    """The process's exit status; None if it hasn't ended after `patience` seconds."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(patience)
    return None
