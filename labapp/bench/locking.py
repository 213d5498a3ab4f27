"""One application at a time owns a device."""

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
"""Options that say which device is meant. Who has none of these is known by all options."""


@contextmanager
def lock_devices(tables: Mapping[str, DeviceTable]) -> Iterator[None]:
    """While the block runs, nobody else on this computer opens these devices, if real.

    tables: by the names that the bench has for them.

    UserError says who has one. Simulated devices are made anew by whoever opens them, and
    need no lock. The system frees the lock of a process that dies.
    """
    with ExitStack() as stack:
        for role, table in tables.items():
            if table.is_exclusive:
                stack.enter_context(_lock(role, table))
        yield


@contextmanager
def _lock(role: str, table: DeviceTable) -> Iterator[None]:
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
    """The file of a lock, which all users of the computer may lock.

    Never deleted: who deletes a lock may delete that of the next one.
    """
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        # In a folder for all, Linux lets nobody "create" a file that another user owns.
        return os.open(path, flags)
    except FileNotFoundError:
        handle = os.open(path, flags | os.O_CREAT, 0o666)
        os.fchmod(handle, 0o666)
        return handle


def _path(table: DeviceTable) -> Path:
    """By driver and address: two bench files may have the same device, and use it otherwise."""
    where = {name: told for name, told in table.options.items() if name in _ADDRESSES}
    found = [table.driver, where or table.options]
    named = json.dumps(found, sort_keys=True, default=str).encode()
    name = hashlib.sha256(named).hexdigest()[:24]
    return Path(tempfile.gettempdir(), f"labapp-{name}.lock")
