"""Write a record frame by frame, each frame to the disk before it is marked as stored."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame, checksum
from labapp.common.errors import UserError
from labapp.files.write_locks import close_locked, has_path, lock_limit
from labapp.runs.record import digests, layout, writer_process
from labapp.runs.record.chain import AT_ONCE, follow_frames, follow_log
from labapp.runs.record.creation import utc_timestamp
from labapp.runs.record.disk_sync import DiskSync, LostWrites
from labapp.runs.record.place_table import TableError, read_table, write_all
from labapp.runs.record.second_copy import find_copy
from labapp.runs.record.writer_process import open_for_writing
from labapp.runs.shots import Shot
from labapp.runs.state import State

_SMALL = 1 << 17
"""Bytes up to which handing a picture to a thread costs more than its digest. Chosen."""

_LARGE = 1 << 22
"""Bytes from which a picture's digest takes longer than the disk to begin with it. Chosen."""


class CorruptFrame(Exception):
    """A frame's picture differs from the one that the camera sent."""


class RecordWriter:
    """Writes frames, state and log into an existing record; a context manager.

    HDF5 isn't used: the table of places tells where each dataset lies. Raises UserError if another
    process writes the record, or its table or chains are damaged.

    lock: handle of create_record() or open_for_writing(), which is closed with the writer.
    """

    def __init__(self, path: Path, lock: int | None = None) -> None:
        self.path = path
        # Opening the file anew after an error doesn't let go of the lock.
        self._lock = open_for_writing(path) if lock is None else lock
        self._digest_thread = ThreadPoolExecutor(1, "digest")
        self.handle = -1
        self._open()
        self._sync = DiskSync(f"/proc/self/fd/{self.handle}")
        try:
            self._continue_chains()
        except (TableError, KeyError) as error:
            self.close()
            raise UserError(
                f"{path}: can't be written on: {error}. Save its frames with: labapp salvage"
            ) from error
        if (self._read("closing", 0) + self._read("end_time", 0)).strip(b"\0"):
            # What was closed is open again; until it is closed anew, nothing promises otherwise.
            self._put("state", 0, State.PLANNED.value.encode())
            self._put("closing", 0, np.zeros((), layout.DIGEST))
            self._put("end_time", 0, b"")
        self._ended: State | None = None
        self._lost = False
        self._put("writer", 0, writer_process.describe_this_process().encode())

    def _continue_chains(self) -> None:
        """Find where links and log lines end."""
        table = read_table(self.handle)
        changing = {name: table.places[name] for name in layout.CHANGING if name in table.places}
        self._places = {name.rpartition("/")[2]: place for name, place in changing.items()}
        self._copy = find_copy(table)
        self._structure = table.read(self.handle, f"{layout.DIGESTS}/structure").tobytes()
        frames = follow_frames(
            table.read_blocks(self.handle, f"{layout.DIGESTS}/chain", AT_ONCE),
            self._structure,
            self.frame_count,
        )
        lines = follow_log(
            table.read_blocks(self.handle, f"{layout.ENTRY}/log", AT_ONCE), self._structure
        )
        for name, broken in (("chain", frames.broken), ("log", lines.broken)):
            if broken is not None:
                raise TableError(f"its {name} is damaged at row {broken}")
        self._links, self._last_link, self._latest = frames.length, frames.last, frames.latest
        self._lines, self._last_line = lines.length, lines.last

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._digest_thread.shutdown()
        self._sync.close()
        if self.handle >= 0:
            os.close(self.handle)
            self.handle = -1
        if self._lock >= 0:
            close_locked(self._lock)
            self._lock = -1

    @property
    def lock_limit(self) -> str:
        """What the lock can't promise, in words; empty if it is a whole one."""
        return lock_limit(self._lock)

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame's image."""
        return self._places["images"].row_bytes

    @property
    def frame_count(self) -> int:
        return self._places["images"].shape[0]

    def reopen(self) -> None:
        """Reopen the file after a failed write, because the old handle may be unusable."""
        os.close(self.handle)
        self.handle = -1
        self._open()

    def store(
        self, shot: Shot, frame: Frame, wavelength: float, *, start_time: float, attempts: int = 1
    ) -> None:
        """Store a frame; on return, it survives the end of this process.

        Raises CorruptFrame if the picture differs from the one that the camera sent, and OSError if
        the disk refuses it; then it isn't marked as stored.

        wavelength: metres. start_time: value of the column `time`, seconds.
        """
        values = {
            "exposure": frame.exposure,
            "wavelength": wavelength,
            "gain": frame.gain,
            "time": start_time,
            "timestamp": time.time(),
            "number": frame.number,
            "attempts": attempts,
        }
        is_whole = not (shot.readout.region or shot.readout.binning)
        if is_whole and frame.image.shape != self._places["images"].shape[1:]:
            raise CorruptFrame(f"it has {frame.image.shape} pixels")
        self.store_values(shot.index, frame.image, values, frame.checksum)

    def store_values(
        self,
        index: int,
        image: NDArray[np.uint16],
        values: Mapping[str, Any],
        known: int | None = None,
    ) -> None:
        """Store a frame's image and measured columns: see `store`.

        values: all measured columns but `checksum` and `stored`. known: the image's CRC-32.
        """
        image = np.ascontiguousarray(image, dtype=self._places["images"].dtype)
        rows, columns = self._places["images"].shape[1:]
        if image.shape != (rows, columns):
            # A frame of a part of the sensor is padded with zeros up to the size of all frames.
            height, width = image.shape
            if height > rows or width > columns:
                raise CorruptFrame(f"it has {image.shape} pixels")
            if known is not None:
                _require_checksum(checksum(image), known)
            image, known = np.pad(image, ((0, rows - height), (0, columns - width))), None
        found, digest = self._write_image(index, image)
        _require_checksum(found, known)
        settings = digests.pack_settings({**values, "checksum": found})
        for name, data in settings.items():
            self._write(name, index, memoryview(data))
        self._append_link(index, digest, b"".join(settings.values()))
        self._put("stored", index, 1)
        try:
            self._sync.note_frame(index)
        except LostWrites as error:
            self._give_up(error.frames)
            raise

    def _give_up(self, frames: Iterable[int]) -> None:
        """Note that frames aren't stored: the disk may lack them, though the system shows them."""
        self._lost = True
        with suppress(OSError):
            for index in frames:
                self._put("stored", index, 0)

    def _write_image(self, index: int, image: NDArray[np.uint16]) -> tuple[int, bytes]:
        """Write a frame's image; return its checksum and its digest."""
        if image.nbytes < _SMALL:
            self._write("images", index, image.data.cast("B"))
            return checksum(image), digests.image_digest(image)
        # It takes about as long as the writing and the checksum together.
        digested = self._digest_thread.submit(digests.image_digest, image)
        self._write("images", index, image.data.cast("B"))
        if image.nbytes >= _LARGE:
            # The advice makes the disk begin; Linux keeps in memory what isn't written yet.
            at = self._places["images"].offset + index * self.frame_bytes
            with suppress(OSError):
                os.posix_fadvise(self.handle, at, image.nbytes, os.POSIX_FADV_DONTNEED)
        return checksum(image), digested.result()

    def _append_link(self, frame: int, image: bytes, values: bytes) -> None:
        """Append a stored frame's link, with its settings, to the chain."""
        if self._links == self._places["chain"].shape[0]:
            raise UserError(
                f"{self.path}: so many frames were taken again that there is no room for their "
                "digests. Save what is there with: labapp salvage"
            )
        settings = digests.packed_digest(values)
        link = digests.link_digest(self._last_link, frame, image, settings)
        row = int(frame).to_bytes(4, "little") + image + settings + link + values
        # Older records have no room for the values.
        self._write("chain", self._links, memoryview(row)[: self._places["chain"].row_bytes])
        self._latest[frame] = self._links
        self._links, self._last_link = self._links + 1, link

    def is_stored_intact(self, index: int) -> bool:
        """Return whether the file holds a frame intact, by its digest."""
        if self._latest[index] < 0:
            return False
        link = self._read("chain", int(self._latest[index]))
        (row,) = np.frombuffer(link, self._places["chain"].dtype)
        image = np.frombuffer(self._read("images", index), np.uint8)
        return digests.image_digest(image) == row["image"].tobytes()

    def log(self, time_: float, text: str) -> None:
        """Add a line to the log; if it is full, count the line as lost."""
        if self._lines == self._places["log"].shape[0]:
            (lost,) = np.frombuffer(self._read("log_lost", 0), self._places["log_lost"].dtype)
            self._put("log_lost", 0, lost + 1)
            return
        # Zeros at the end of a text of fixed length would be lost.
        cut = text.encode()[: layout.LOG_ROW["text"].itemsize].rstrip(b"\0")
        digest = digests.line_digest(self._last_line, time_, cut)
        self._put("log", self._lines, (time_, cut, np.frombuffer(digest, np.uint8)))
        before = self._lines, self._last_line
        self._lines, self._last_line = self._lines + 1, digest
        if self._ended:
            try:
                self._close_record(self._ended)
            except OSError:
                # The caller writes the line once more.
                self._lines, self._last_line = before
                raise

    def set_state(self, state: State, message: str = "") -> str:
        """Write a state and its reason, and the time if the run has ended.

        Returns the closing digest of an ended run in hexadecimal, otherwise an empty text. A run
        is COMPLETE only once all of its record is on the disk, and has ended when its end is, too.
        Raises OSError if that can't be; what the disk has lost is told once.
        """
        if state.has_ended:
            # Who finds an end in the record may rely on all that came before.
            self._flush_end(state)
        digest = self._write_state(state, message)
        if state.has_ended:
            self._flush_end(state)
        return digest

    def _flush_end(self, state: State) -> None:
        """Flush at a run's end; raise a loss that was told before again only if COMPLETE."""
        was_told = self._lost
        try:
            self.flush()
        except LostWrites:
            if state is State.COMPLETE or not was_told:
                raise

    def flush(self) -> None:
        """Return when all is on the disk; give up frames that it refuses."""
        try:
            self._sync.flush()
        except LostWrites as error:
            self._give_up(error.frames)
            raise

    def _write_state(self, state: State, message: str) -> str:
        told = np.array(message.encode()[: layout.MESSAGE.itemsize], layout.MESSAGE)
        name = np.array(state.value.encode(), layout.STATE)
        if [self._read(one, 0) for one in ("state", "message")] == [name.tobytes(), told.tobytes()]:
            closing = self._closing_digest(state)
            if state.has_ended and self._read("closing", 0) == closing:
                # Written anew, the end would be a half-written one for a moment.
                return closing.hex()
        self._ended = state if state.has_ended else None
        self._put("message", 0, told)
        self._put("end_time", 0, utc_timestamp().encode() if self._ended else b"")
        digest = self._close_record(self._ended)
        self._put("state", 0, name)
        return digest

    def _close_record(self, ended: State | None) -> str:
        """Write the digest over all for a final state, or zeros for None; return it, or ""."""
        digest = self._closing_digest(ended) if ended else bytes(layout.DIGEST.itemsize)
        self._put("closing", 0, np.frombuffer(digest, np.uint8))
        return digest.hex() if ended else ""

    def _closing_digest(self, state: State) -> bytes:
        """Return the digest over all with the state that the record is about to have."""
        ending = {name: self._read(name, 0) for name in digests.ENDING}
        ending["state"] = np.array(state.value.encode(), layout.STATE).tobytes()
        return digests.closing_digest(
            self._structure, self._links, self._last_link, self._lines, self._last_line,
            ending.values(),
        )  # fmt: skip

    def _open(self) -> None:
        # By its path, a file is found again after a move; but the path may name another by now.
        path = self.path if has_path(self._lock, self.path) else f"/proc/self/fd/{self._lock}"
        self.handle = os.open(path, os.O_RDWR | os.O_CLOEXEC)

    def _put(self, name: str, row: int, value: Any) -> None:
        """Write a row of a dataset at its place in the file."""
        place = self._places[name]
        self._write(name, row, memoryview(np.array(value, place.dtype).tobytes()))

    def _read(self, name: str, row: int) -> bytes:
        """Read the bytes of a row; fewer if the file ends before the row."""
        place = self._places[name]
        return os.pread(self.handle, place.row_bytes, place.offset + row * place.row_bytes)

    def _write(self, name: str, row: int, data: memoryview) -> None:
        place = self._places[name]
        offset = place.offset + row * place.row_bytes
        if self._copy is not None and self._copy.has(place):
            # First, so that what comes before the log never says more than is there twice.
            write_all(self.handle, data, self._copy.begin + offset)
        write_all(self.handle, data, offset)


def _require_checksum(found: int, known: int | None) -> None:
    """Raise CorruptFrame if an image isn't the one that the camera sent."""
    if known is not None and found != known:
        raise CorruptFrame(f"its checksum is {found:08x}, the camera's {known:08x}")
