"""A device's process, as its parent sees it: how it is started and how it is ended."""

from __future__ import annotations

import contextlib
import mmap
import os
import signal
import socket
import subprocess
import sys

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
    ours, theirs = socket.socketpair()
    memory = os.memfd_create("labapp-device")
    os.ftruncate(memory, mmap.PAGESIZE)
    channel = Channel(ours.detach(), os.dup(memory))
    given = (theirs.fileno(), memory)
    command = [sys.executable, "-u", "-X", "faulthandler", "-c", _CHILD]
    command += [str(number) for number in (*given, _GRACE)] + sys.path
    # Blocked until the child ignores them: Ctrl-C must not find it half awake.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, IGNORED)
    try:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=2, pass_fds=given)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        os.close(memory)
    return channel, process


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
