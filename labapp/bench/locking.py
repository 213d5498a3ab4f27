"""Lock devices, so that only one application at a time uses a device."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.bench_file import DeviceTable

_ADDRESSES = frozenset(
    ("address", "backend", "device", "display", "host", "index", "port", "screen", "serial")
)
"""Driver options that identify a device. A device without any is identified by all its options."""


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
                stack.enter_context(_lock(role, table))
        yield


@contextmanager
def _lock(role: str, table: DeviceTable) -> Iterator[None]:
    """Lock one of the bench's real devices while the block runs."""
    path = _path(table)
    try:
        handle = _open_lock_file(path)
    except OSError as error:
        raise UserError(
            f"the {role} ({table.driver}) can't be locked: {path}: {error.strerror}. "
            "Remove that file when nobody uses the device."
        ) from error
    with os.fdopen(handle, "r+", encoding="utf-8", errors="backslashreplace") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            owner = file.read().strip() or "another application"
            raise UserError(
                f"the {role} ({table.driver}) is in use by {owner}. Close that first."
            ) from error
        file.truncate(0)
        command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:3]])
        file.write(f"{command} (process {os.getpid()}, since {datetime.now():%H:%M})")
        file.flush()
        yield


def _open_lock_file(path: Path) -> int:
    """Open the lock file of a bench device, which all users of the computer may lock.

    The file is never deleted, because a process could delete the lock of its successor.
    """
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        # O_CREAT isn't set at first: in a folder that all users may write to, Linux refuses it for
        # an existing file that another user owns.
        return os.open(path, flags)
    except FileNotFoundError:
        handle = os.open(path, flags | os.O_CREAT, 0o666)
        os.fchmod(handle, 0o666)
        return handle


def _path(table: DeviceTable) -> Path:
    """Return the path of a bench device's lock file, which its driver and address determine.

    Two bench files may describe the same device with different options.
    """
    where = {name: told for name, told in table.options.items() if name in _ADDRESSES}
    found = [table.driver, where or table.options]
    named = json.dumps(found, sort_keys=True, default=str).encode()
    name = hashlib.sha256(named).hexdigest()[:24]
    return Path(tempfile.gettempdir(), f"labapp-{name}.lock")
