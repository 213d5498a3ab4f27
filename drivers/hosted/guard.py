"""A process that makes devices safe if the process that uses them is killed."""

from __future__ import annotations

import contextlib
import pkgutil
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from drivers.hosted.calls import Notification
from drivers.hosted.child_process import ChildProcess
from drivers.hosted.message_socket import MessageSocket

_GRACE = 120.0
"""Seconds that a guard has to make its devices safe; the longest to open takes a minute. Chosen."""


class GuardedDevice(NamedTuple):
    """A device, and how a guard opens it.

    name: in messages. factory, options: as of `HostedDevice`.
    """

    name: str
    factory: str
    options: Mapping[str, Any]


@contextlib.contextmanager
def guard_devices(devices: Sequence[GuardedDevice]) -> Iterator[None]:
    """Have another process open devices and make them safe if this one is killed in the block.

    The guard has no device open before. It is in a session of its own, so that not even a kill of
    the whole process group reaches it, and ends with the block or when it has done its work.
    Without devices, there is none. Raises OSError if no process can be started.
    """
    if not devices:
        yield
        return
    process = ChildProcess(
        "drivers.hosted.guard:serve_guard", list(devices), grace=_GRACE, own_session=True
    )
    try:
        yield
    finally:
        process.send(Notification("release"))
        process.close()


def serve_guard(line: MessageSocket, devices: Sequence[GuardedDevice]) -> None:
    """Wait, as the guard's process, until the devices are released or their user was killed."""
    try:
        line.receive()
    except (EOFError, OSError):
        threads = [threading.Thread(target=_leave_safe, args=(one,)) for one in devices]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


def _leave_safe(one: GuardedDevice) -> None:
    """Open a device whose user was killed, and make it safe; print what came of it."""
    from drivers.clock import RealClock
    from drivers.interfaces import Surroundings

    try:
        make = pkgutil.resolve_name(one.factory)
        with make(Surroundings(RealClock()), **one.options) as device:
            device.make_safe()
    except Exception as error:
        told = f"the program was killed, and the {one.name} couldn't be made safe: {error}"
    else:
        told = f"the program was killed; the {one.name} was made safe"
    with contextlib.suppress(OSError):
        print(told, file=sys.stderr, flush=True)
