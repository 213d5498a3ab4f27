"""The calls by which this process changes a folder, seen in Python, and syncs that fail.

Much quicker than strace, but blind to what libraries write by themselves: compare what a file
holds at the end with what was recorded.
"""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from disks.trace import Event

CALLS = ("open", "write", "pwrite", "ftruncate", "fsync", "fdatasync")
CALLS += ("link", "rename", "replace", "unlink", "mkdir", "rmdir")


class Recorder:
    """A context manager. fails: number of the sync that fails, from 1, and with which error.

    Attributes: events, and how many syncs there were.
    """

    def __init__(self, folder: Path, fails: int = 0, error: int = 0) -> None:
        self._folder, self._fails, self._error = str(folder), fails, error
        self.events: list[Event] = []
        self.syncs = 0
        self._patches = [patch.object(os, name, self._watching(name)) for name in CALLS]

    def __enter__(self) -> Recorder:
        for one in self._patches:
            one.start()
        return self

    def __exit__(self, *error: object) -> None:
        for one in self._patches:
            one.stop()

    def tell(self, words: str) -> None:
        self._note("told", data=words.encode())

    def _note(self, kind: str, path: str = "", other: str = "", **more: Any) -> None:
        self.events.append(Event(time.time(), kind, path, other, **more))

    def _watching(self, name: str) -> Callable[..., Any]:
        call, watch = getattr(os, name), getattr(self, f"_{name}", None)

        def watched(*given: Any, **more: Any) -> Any:
            if watch is not None:
                return watch(call, *given, **more)
            paths = [os.path.abspath(one) for one in given if isinstance(one, str | os.PathLike)]
            done = call(*given, **more)
            if any(self._is_inside(path) for path in paths):
                self._note("rename" if name == "replace" else name, paths[0], paths[-1])
            return done

        return watched

    def _is_inside(self, path: str) -> bool:
        return path == self._folder or path.startswith(self._folder + "/")

    def _open(
        self, call: Callable[..., int], path: Any, flags: int, *rest: Any, **more: Any
    ) -> int:
        handle = call(path, flags, *rest, **more)
        if flags & (os.O_CREAT | os.O_TRUNC) and self._is_inside(there := _path(handle)):
            self._note("open", there, size=int(bool(flags & os.O_TRUNC)))
        return handle

    def _write(self, call: Callable[..., int], handle: int, data: bytes) -> int:
        if self._is_inside(path := _path(handle)):
            raise ValueError(f"{path} is written in a way that isn't seen")
        return call(handle, data)

    def _pwrite(self, call: Callable[..., int], handle: int, data: Any, place: int) -> int:
        done = call(handle, data, place)
        if self._is_inside(path := _path(handle)):
            self._note("write", path, data=bytes(data)[:done], size=place)
        return done

    def _ftruncate(self, call: Callable[..., None], handle: int, size: int) -> None:
        call(handle, size)
        if self._is_inside(path := _path(handle)):
            self._note("size", path, size=size)

    def _fsync(self, call: Callable[..., None], handle: int, name: str = "fsync") -> None:
        if not self._is_inside(path := _path(handle)):
            call(handle)
            return
        self.syncs += 1
        number = self.syncs
        self._note("begin", path, number=number)
        if number != self._fails:
            call(handle)
        fails = number == self._fails
        self._note("end", path, name, size=int(not fails), number=number)
        if fails:
            raise OSError(self._error, os.strerror(self._error))

    def _fdatasync(self, call: Callable[..., None], handle: int) -> None:
        self._fsync(call, handle, "fdatasync")


def _path(handle: int) -> str:
    if stat.S_ISSOCK(os.fstat(handle).st_mode):
        return ""
    return os.readlink(f"/proc/self/fd/{handle}").removesuffix(" (deleted)")
