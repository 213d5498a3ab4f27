"""Store frames on the disk; a full disk pauses the run."""

from __future__ import annotations

import errno
import logging
import os
import time
from collections.abc import Callable
from pathlib import Path

from drivers.interfaces import Frame
from labapp.common.errors import UserError
from labapp.runs.record.writer import RecordWriter
from labapp.runs.shots import Shot

log = logging.getLogger(__name__)

_FULL = (errno.ENOSPC, errno.EDQUOT)


Pause = Callable[[str, Callable[[], bool]], None]
"""Pauses the run for a reason in words, until the function given as second argument is true."""


UNTOLD = 1 << 62
"""Free bytes of a disk that doesn't tell them, as some network shares don't: a write will tell."""


def free_bytes(path: Path) -> int:
    """Return the bytes that the user may still write to a path's disk, or UNTOLD."""
    try:
        at = os.statvfs(path.parent if not path.exists() else path)
    except OSError as error:
        if error.errno not in (errno.ENOSYS, errno.EOPNOTSUPP):
            raise
        return UNTOLD
    return at.f_bavail * at.f_frsize if at.f_blocks else UNTOLD


def require_space(path: Path, needed: int) -> None:
    """Raise UserError if the disk lacks room for `needed` bytes plus a tenth."""
    free = free_bytes(path)
    # A record that is replaced frees its space.
    free += path.stat().st_blocks * 512 if path.exists() else 0
    reserved = 1.1 * needed
    if free < reserved:
        raise UserError(
            f"{path}: the run needs {reserved / 1e6:.0f} MB, and its disk has "
            f"{free / 1e6:.0f} MB free. Make space, or choose another place."
        )


class FrameStore:
    """Stores frames in the record, and pauses the run when the disk is full.

    use_planned_times: whether frames are stored with their planned time, as on a virtual bench,
        instead of the clock's.
    pause: called when the disk is full.
    """

    def __init__(self, writer: RecordWriter, use_planned_times: bool, pause: Pause) -> None:
        self._writer, self._frame_bytes = writer, writer.frame_bytes
        self._as_planned, self._pause = use_planned_times, pause
        self._try_at = 0.0

    def wait_for_space(self) -> None:
        """Wait until the disk has room for the next frame."""
        if not self._has_space():
            self._pause(self._disk_full_message(), self._has_space)

    def store_frame(self, shot: Shot, frame: Frame, wavelength: float, attempts: int) -> None:
        """Store a frame, and return when it is on disk; raise OSError if the disk fails."""

        moment = shot.start_time if self._as_planned else frame.time

        def store() -> None:
            self._writer.store(shot, frame, wavelength, start_time=moment, attempts=attempts)

        try:
            store()
        except OSError as error:
            require_full(error)
            log.warning("frame %d: %s", shot.index, error.strerror)
            self._pause(self._disk_full_message(), lambda: self._retry_store(store, shot.index))

    def _retry_store(self, store: Callable[[], None], index: int) -> bool:
        """Try to store a frame again; return whether it is on the disk intact.

        Nothing is tried within 0.2 s of the last try, or while the disk is full. The frame is read
        back, because an earlier write was refused.
        """
        if time.monotonic() < self._try_at or not self._has_space():
            return False
        # A write may be refused although the disk seems to have room, so tries are 0.2 s apart.
        self._try_at = time.monotonic() + 0.2
        try:
            self._writer.reopen()
            store()
        except OSError as error:
            require_full(error)
            return False
        return self._writer.is_stored_intact(index)

    def _has_space(self) -> bool:
        # 64 KiB must remain free, because file systems need space for their own data.
        return free_bytes(self._writer.path) >= self._frame_bytes + (1 << 16)

    def _disk_full_message(self) -> str:
        return (
            f"the disk of {self._writer.path} is full. Make space: the run goes on by itself, "
            "and no frame is lost"
        )


def require_full(error: OSError) -> None:
    """Re-raise an error of the disk, unless it or the user's quota is full."""
    if error.errno not in _FULL:
        raise error
