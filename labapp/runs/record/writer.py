"""Write a record frame by frame, each frame to the disk before it is marked as stored."""

from __future__ import annotations

import fcntl
import os
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from drivers.interfaces import Frame, checksum
from labapp.common.errors import UserError
from labapp.runs.record import layout, writer_process
from labapp.runs.record.creation import utc_timestamp
from labapp.runs.state import State
from labapp.runs.steps import Shot

_ENTRY_FIELDS = ("state", "message", "end_time", "writer", "log")


class CorruptFrame(Exception):
    """A frame's picture differs from the one that the camera sent."""


@dataclass(frozen=True)
class _Place:
    """The place of a dataset in a record's file: its offset in bytes, shape and type."""

    offset: int
    shape: tuple[int, ...]
    dtype: np.dtype

    @property
    def row_bytes(self) -> int:
        return int(np.prod(self.shape[1:], dtype=np.int64)) * self.dtype.itemsize


class RecordWriter:
    """Writes frames, state and log into an existing record; a context manager.

    HDF5 is used only to find the place of each dataset; see labapp.runs.record.layout. Raises
    UserError if another process writes the record.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with h5py.File(path, "r") as file:
            names = [*(f"{layout.ENTRY}/{name}" for name in _ENTRY_FIELDS)]
            names += [f"{layout.DATA}/{name}" for name in ("images", *layout.MEASURED)]
            self._places = {name.rpartition("/")[2]: _place(file[name]) for name in names}
            written = np.flatnonzero(file["entry/log"]["text"] != b"")
        self._log_length = int(written[-1]) + 1 if len(written) else 0
        self._checksum_thread = ThreadPoolExecutor(1, "checksum")
        self._handle = -1
        self._open()
        self._put("writer", 0, writer_process.describe_this_process().encode())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._checksum_thread.shutdown()
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def reopen(self) -> None:
        """Reopen the run's record after a failed write, because the old handle may be unusable."""
        os.close(self._handle)
        self._handle = -1
        self._open()

    def store(
        self, shot: Shot, frame: Frame, wavelength: float, *, start_time: float, attempts: int = 1
    ) -> None:
        """Store a frame in the run's record; on return, it survives the end of this process.

        `start_time` is the value of the column `time`. Raises CorruptFrame if the picture differs
        from the one that the camera sent, and OSError if the disk refuses it. In both cases the
        frame isn't marked as stored.
        """
        image = np.ascontiguousarray(frame.image, dtype=self._places["images"].dtype)
        if image.shape != self._places["images"].shape[1:]:
            raise CorruptFrame(f"it has {image.shape} pixels")
        # The checksum is computed while the picture is being written.
        summed = self._checksum_thread.submit(checksum, image)
        self._write("images", shot.index, image.data.cast("B"))
        found = summed.result()
        if frame.checksum is not None and found != frame.checksum:
            raise CorruptFrame(f"its checksum is {found:08x}, the camera's {frame.checksum:08x}")
        values = {
            "exposure": frame.exposure,
            "wavelength": wavelength,
            "gain": frame.gain,
            "time": start_time,
            "timestamp": time.time(),
            "number": frame.number,
            "attempts": attempts,
            "checksum": found,
        }
        for name, value in values.items():
            self._put(name, shot.index, value)
        self._put("stored", shot.index, 1)

    def is_stored_intact(self, index: int) -> bool:
        """Return whether the file of the run's record holds a frame intact, by its checksum."""
        data, known = self._read("images", index), self._read("checksum", index)
        if len(data) < self._places["images"].row_bytes:
            return False
        return checksum(np.frombuffer(data, np.uint16)) == np.frombuffer(known, np.uint32)[0]

    def log(self, time_: float, text: str) -> None:
        """Add a line to the log of the run's record; if it is full, overwrite its last line."""
        row = min(self._log_length, self._places["log"].shape[0] - 1)
        self._put("log", row, (time_, text.encode()[:200]))
        self._log_length += 1

    def set_state(self, state: State, message: str = "") -> None:
        """Write the run's state and its reason to the record, and the time if the run has ended."""
        self._put("message", 0, message.encode()[: layout.MESSAGE.itemsize])
        self._put("end_time", 0, utc_timestamp().encode() if state.has_ended else b"")
        self._put("state", 0, state.value.encode())

    def _open(self) -> None:
        self._handle = os.open(self.path, os.O_RDWR | os.O_CLOEXEC)
        try:
            # The lock belongs to the open file, not to the process. It covers one byte far beyond
            # the file's end, so that it doesn't interfere with HDF5's own locks.
            lock = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 2**62, 1, 0)
            fcntl.fcntl(self._handle, fcntl.F_OFD_SETLK, lock)
        except OSError as error:
            self.close()
            raise UserError(
                f"{self.path}: is being written by another process. Wait for it to end."
            ) from error

    def _put(self, name: str, row: int, value: Any) -> None:
        """Write a row of a dataset at its place in the file of the run's record."""
        place = self._places[name]
        self._write(name, row, memoryview(np.array(value, place.dtype).tobytes()))

    def _read(self, name: str, row: int) -> bytes:
        """Read the bytes of a row in the run's record; fewer if the file ends before the row."""
        place = self._places[name]
        return os.pread(self._handle, place.row_bytes, place.offset + row * place.row_bytes)

    def _write(self, name: str, row: int, data: memoryview) -> None:
        place = self._places[name]
        offset = place.offset + row * place.row_bytes
        while data:
            written = os.pwrite(self._handle, data, offset)
            data, offset = data[written:], offset + written


def _place(dataset: h5py.Dataset) -> _Place:
    """Return where a dataset of the run's record lies in its file."""
    return _Place(dataset.id.get_offset(), dataset.shape, dataset.dtype)
