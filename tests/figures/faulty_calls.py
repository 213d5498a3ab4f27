"""Calls of the system that fail where they are told to, in this process.

Only calls that concern files in one folder count, so that what a process prints, or says to another
one, isn't touched. Files of Python's `open` are those of `_pyio`, which asks the system through the
same functions of `os`.
"""

from __future__ import annotations

import _io
import _pyio
import builtins
import errno
import io
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

SHORT = -1
"""In the place of an error: the system writes only a part, as it may at any time."""

MESSAGE = "message"
"""The kind of fault that isn't a call of the system's."""

GONE, STUCK, CUT = -2, -3, -4
"""What can become of the process to which a message goes: killed, stopped, its line cut."""

KINDS: dict[str, tuple[str, ...]] = {
    "write": ("write", "pwrite", "writev", "pwritev", "sendfile", "copy_file_range"),
    "sync": ("fsync", "fdatasync"),
    "name": ("rename", "replace", "link", "symlink"),
    "size": ("truncate", "ftruncate", "posix_fallocate"),
    "open": ("open",),
    "unlink": ("unlink", "remove", "rmdir"),
    "folder": ("mkdir", "scandir", "listdir"),
    "read": ("read", "pread"),
}
"""Functions of `os` by kind of call."""

CAUSES: dict[str, tuple[int, ...]] = {
    "write": (errno.EIO, errno.ENOSPC, SHORT),
    "sync": (errno.EIO, errno.ENOSPC),
    "name": (errno.EIO, errno.ENOSPC),
    "size": (errno.EIO, errno.ENOSPC),
    "open": (errno.EIO, errno.ENOSPC, errno.EMFILE),
    "unlink": (errno.EIO,),
    "folder": (errno.EIO, errno.ENOSPC),
    "read": (errno.EIO,),
}
"""Errors by kind of call, as the manual pages of the calls name them."""


@dataclass(frozen=True)
class Fault:
    """A fault of the n-th call of a kind, counted from 1, or of all from the n-th on; 0 is none."""

    kind: str
    number: int
    cause: int
    lasting: bool

    def __str__(self) -> str:
        words = {SHORT: "short", GONE: "process killed", STUCK: "process stopped", CUT: "line cut"}
        what = words.get(self.cause) or errno.errorcode[self.cause]
        return f"{what} at {self.kind} {self.number}{' and all later' if self.lasting else ''}"


class FaultCounter:
    """Counts what may fail, and tells when it is to."""

    def __init__(self, fault: Fault, folder: str) -> None:
        self._fault, self._folder = fault, folder
        self._lock = threading.Lock()
        self.count = self.failed = 0
        self.what = ""

    def _is_due(self, what: str) -> bool:
        """Whether this call is to fail."""
        with self._lock:
            self.count += 1
            first, now = self._fault.number, self.count
            due = now == first or (self._fault.lasting and 0 < first < now)
            if due:
                self.failed += 1
                self.what = self.what or what
            return due


class FaultyCalls(FaultCounter):
    """Counts the calls of a fault's kind that concern files in a folder, and lets them fail."""

    def install(self) -> None:
        """Put the failing functions into `os`, for the rest of this process."""
        for name in KINDS[self._fault.kind]:
            setattr(os, name, self._wrap(name, getattr(os, name)))
        for module in (builtins, io, _io):
            module.open = _pyio.open  # type: ignore[assignment]

    def _wrap(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def ask(*given: Any, **options: Any) -> Any:
            if not self._concerns(given) or not self._is_due(f"{name} {given[0]}"):
                return call(*given, **options)
            if self._fault.cause != SHORT:
                raise OSError(self._fault.cause, os.strerror(self._fault.cause), _name(given[0]))
            return call(*_shortened(given), **options)

        return ask

    def _concerns(self, given: tuple[Any, ...]) -> bool:
        """Whether one of a call's first two arguments is in the folder, by its path."""
        return any(_path(one).startswith(self._folder) for one in given[:2])


def _path(one: Any) -> str:
    """The path of what a call is given, by a path or a descriptor; empty for anything else."""
    try:
        if isinstance(one, int):
            return os.readlink(f"/proc/self/fd/{one}")
        return os.path.realpath(os.fsdecode(os.path.abspath(one)))
    except (OSError, TypeError, ValueError):
        return ""


def _name(one: Any) -> Any:
    return None if isinstance(one, int) else one


def _shortened(given: tuple[Any, ...]) -> tuple[Any, ...]:
    """The arguments of a write, of which only the first half is written, but a byte at least."""
    return tuple(
        one[: max(1, len(one) // 2)] if isinstance(one, bytes | bytearray | memoryview) else one
        for one in given
    )
