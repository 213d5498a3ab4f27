"""Lock devices, so that only one application at a time on this computer uses a device."""

from __future__ import annotations

import hashlib
import os
import pwd
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from drivers.interfaces import Identity
from labapp.bench.device_names import device_names
from labapp.common.errors import UserError
from labapp.common.named_locks import find_lock_holder, take_named_lock
from labapp.files.bench_file import DeviceTable

_PREFIX = "labapp-device"
"""What the names of the locks begin with."""

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
    full = f"{_PREFIX}-{hashlib.sha256(name.encode()).hexdigest()[:32]}"
    lock = take_named_lock(full)
    if lock is None:
        raise UserError(f"{device} is in use by {_owner(full)}. Close that first.")
    with lock:
        yield


def _owner(lock: str) -> str:
    """Return who holds the lock of a bench's device, in words."""
    if (found := find_lock_holder(lock)) is None:
        return "another application"
    process, user = found
    of_user = "" if user == os.getuid() else f" of {_user_name(user)}"
    return f"{_command(process)} (process {process}{of_user})"


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
