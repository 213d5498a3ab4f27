"""New HDF5 files of NeXus groups, written so that no write that the disk refuses goes unnoticed.

They are written through Python: HDF5's own files may swallow a write that fails while it flushes
its caches, and later crash on what they kept.
"""

from __future__ import annotations

import io
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

import h5py

import labapp
from labapp.common.program_version import source_commit

_PACKAGES = ("numpy", "scipy", "torch", "h5py")


def create_group(parent: h5py.Group, name: str, kind: str) -> h5py.Group:
    """Create a group of a NeXus class."""
    made = parent.create_group(name)
    made.attrs["NX_class"] = kind
    return made


def program_versions() -> dict[str, str]:
    """Return labapp's version and commit, and the versions of what computed results depend on."""
    found = {name: version(name) for name in _PACKAGES}
    own = {"labapp": labapp.__version__, "commit": source_commit() or "unknown"}
    return {**own, "python": platform.python_version(), **found}


def write_all(handle: int, data: memoryview, offset: int) -> None:
    """Write bytes at their place in an open file, which may take several calls."""
    while data:
        written = os.pwrite(handle, data, offset)
        data, offset = data[written:], offset + written


@contextmanager
def create_hdf5(handle: int, **options: Any) -> Iterator[h5py.File]:
    """Write a new HDF5 file to an open, empty file; OSError if the disk refuses any of it.

    options: those of `h5py.File`. Nothing is locked: the file is a draft, or locked already, and
    its file system may have no locks for HDF5.
    """
    out = DraftFile(handle)
    try:
        with h5py.File(out, "w", locking=False, **options) as file:
            yield file
    finally:
        # HDF5 may hide the error behind another one, or behind none.
        out.require_whole()


class DraftFile(io.RawIOBase):
    """An open file as h5py takes one; `error` is what the disk has refused, if anything."""

    def __init__(self, handle: int) -> None:
        self._handle, self._position = handle, 0
        self.error: OSError | None = None

    def flush(self) -> None:
        """Do nothing: what is written isn't kept here."""

    def tell(self) -> int:
        return self._position

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._position}
        size = start[whence] if whence in start else os.fstat(self._handle).st_size
        self._position = size + offset
        return self._position

    def readinto(self, buffer: Any) -> int:
        data = os.pread(self._handle, len(buffer), self._position)
        buffer[: len(data)] = data
        self._position += len(data)
        return len(data)

    def write(self, data: Any) -> int:
        try:
            write_all(self._handle, memoryview(data), self._position)
        except OSError as error:
            self.error = error
            raise
        self._position += len(data)
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        size = self._position if size is None else size
        try:
            os.ftruncate(self._handle, size)
        except OSError as error:
            self.error = error
            raise
        return size

    def require_whole(self) -> None:
        """Raise the OSError with which the disk refused any part, if it did."""
        if self.error is not None:
            raise self.error
