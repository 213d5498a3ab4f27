"""Lock devices, so that only one application at a time on this computer uses a device."""

from __future__ import annotations

import hashlib
import os
import pwd
import socket
import struct
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from drivers.interfaces import Identity
from labapp.bench.device_names import device_names
from labapp.common.errors import UserError
from labapp.files.bench_file import DeviceTable

_PREFIX = "labapp-device"
"""What the names of the locks begin with."""

_ANSWER_TIMEOUT = 0.5
"""Seconds within which the system must say who holds a lock. Chosen: it takes microseconds."""

_COMMAND_WORDS = 3
"""Words of a command that are told of the one that holds a lock. Chosen."""


@contextmanager
def lock_devices(tables: Mapping[str, DeviceTable]) -> Iterator[None]:
    """Lock the bench's real devices on this computer for this process while the block runs.

    Simulated devices need no lock, because each application creates its own. The operating system
    releases the locks of a process that dies.

    Parameters
    ----------
    tables : mapping
        Device tables of the bench file, by their names on the bench.

    Raises
    ------
    UserError
        If another application uses a device; the message names it.
    """
    with ExitStack() as stack:
        for role, table in tables.items():
            if table.is_exclusive:
                for name in device_names(table):
                    stack.enter_context(_lock(name, f"the {role} ({table.driver})"))
        yield


@contextmanager
def lock_serial_number(role: str, table: DeviceTable, identity: Identity) -> Iterator[None]:
    """Lock an open device of the bench by its serial number, while the block runs.

    Another application may have it open by another address. Raises UserError if one has.
    """
    # Makers of webcams give all of a model the same number.
    if not (table.is_exclusive and identity.serial) or table.driver == "uvc-camera":
        yield
        return
    if identity.simulated or table.simulated:
        yield
        return
    name = f"{identity.model} {identity.serial}"
    with _lock(name, f"the {role} ({table.driver}, {name})"):
        yield


@contextmanager
def _lock(name: str, device: str) -> Iterator[None]:
    """Lock a device of the bench by a name of it while the block runs."""
    # A socket's abstract name belongs to nobody's folder, and goes with its process: nothing stays
    # behind that another user could lock a device with, or couldn't remove.
    address = f"\0{_PREFIX}-{hashlib.sha256(name.encode()).hexdigest()[:32]}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as lock:
        try:
            lock.bind(address)
        except OSError as error:
            raise UserError(
                f"{device} is in use by {_owner(address)}. Close that first."
            ) from error
        lock.listen()
        yield


def _owner(address: str) -> str:
    """Return who holds the lock of a bench's device, in words."""
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as question:
        question.settimeout(_ANSWER_TIMEOUT)
        question.connect(address)
        told = question.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        process, user, _ = struct.unpack("3i", told)
        of_user = "" if user == os.getuid() else f" of {_user_name(user)}"
        return f"{_command(process)} (process {process}{of_user})"
    return "another application"


def _user_name(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return f"user {user}"


def _command(process: int) -> str:
    """Return the command of the process that holds a device of the bench, in words.

    The window's engine is a child of the process that was called as a command.
    """
    for number in (process, _parent(process)):
        words = _words(number)
        names = [Path(word).name for word in words]
        if "labapp" in names:
            start = names.index("labapp")
            return " ".join(["labapp", *words[start + 1 : start + _COMMAND_WORDS]])
    words = _words(process)
    return words[1] if len(words) > 1 and not words[1].startswith("-") else "another application"


def _words(process: int) -> list[str]:
    """Return the words of a process's command, printable; none if it is gone or hidden."""
    try:
        told = Path("/proc", str(process), "cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return []
    return ["".join(c if c.isprintable() else "?" for c in word) for word in told.split("\0")[:-1]]


def _parent(process: int) -> int:
    """Return the parent of a process that holds a device of the bench; 0 if it can't be told."""
    try:
        told = Path("/proc", str(process), "stat").read_text()
    except OSError:
        return 0
    return int(told.rpartition(")")[2].split()[1])
