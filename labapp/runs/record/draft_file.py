"""The file of a new record, as HDF5 writes it through Python: no refused write goes unnoticed.

HDF5's own files may swallow a write that fails while it flushes its caches, and later crash on what
they kept.
"""

from __future__ import annotations

import io
import os
from typing import Any

from labapp.runs.record.place_table import write_all


class DraftFile(io.RawIOBase):
    """An open file as h5py takes one. error: what the disk has refused, if anything."""

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
        """Raise the OSError with which the disk refused a part of the record, if it did."""
        if self.error is not None:
            raise self.error
