"""Frames go to the disk before anybody hears of them; a full disk makes the run wait."""

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
from labapp.runs.steps import Shot

log = logging.getLogger(__name__)

_FULL = (errno.ENOSPC, errno.EDQUOT)

_SPARE = 1 << 16
"""Bytes that must be free beside the next frame: file systems keep books of their own."""

_RETRY_INTERVAL = 0.2
"""Seconds between tries of a write that was refused though the disk seems to have room."""

_RESERVE = 1.1
"""Of the expected size that must be free before a run begins."""

Pause = Callable[[str, Callable[[], bool]], None]
"""Says why the run waits, and returns when the second argument turns true."""


def free_bytes(path: Path) -> int:
    """What a user may still write to the disk of a file."""
    at = os.statvfs(path.parent if not path.exists() else path)
    return at.f_bavail * at.f_frsize


def require_space(path: Path, needed: int) -> None:
    """UserError if the disk hasn't room for a record and a tenth more."""
    free = free_bytes(path)
    # What is replaced will be free.
    free += path.stat().st_blocks * 512 if path.exists() else 0
    if free < _RESERVE * needed:
        raise UserError(
            f"{path}: the run needs {_RESERVE * needed / 1e6:.0f} MB, and its disk has "
            f"{free / 1e6:.0f} MB free. Make space, or choose another place."
        )


class FrameStore:
    """Puts frames into a record.

    frame_bytes: of a picture. use_planned_times: whether frames keep the moment of the plan, as on
    a virtual bench, instead of the clock's time. pause: is called when the disk is full.
    """

    def __init__(
        self, writer: RecordWriter, frame_bytes: int, use_planned_times: bool, pause: Pause
    ) -> None:
        self._writer, self._frame_bytes = writer, frame_bytes
        self._as_planned, self._pause = use_planned_times, pause
        self._try_at = 0.0

    def wait_for_space(self) -> None:
        """Return when the next frame has room, before it is taken."""
        if not self._has_space():
            self._pause(self._disk_full_message(), self._has_space)

    def store_frame(self, shot: Shot, frame: Frame, wavelength: float, attempts: int) -> None:
        """Return when the frame is on the disk; OSError if the disk fails for good."""

        moment = shot.start_time if self._as_planned else frame.time

        def store() -> None:
            self._writer.store(shot, frame, wavelength, start_time=moment, attempts=attempts)

        try:
            store()
        except OSError as error:
            _require_full(error)
            log.warning("frame %d: %s", shot.index, error.strerror)
            self._pause(self._disk_full_message(), lambda: self._retry_store(store, shot.index))

    def _retry_store(self, store: Callable[[], None], index: int) -> bool:
        """Try again, once in a while; what a disk took after all is believed when it is seen."""
        if time.monotonic() < self._try_at or not self._has_space():
            return False
        self._try_at = time.monotonic() + _RETRY_INTERVAL
        try:
            self._writer.reopen()
            store()
        except OSError as error:
            _require_full(error)
            return False
        return self._writer.is_stored_intact(index)

    def _has_space(self) -> bool:
        return free_bytes(self._writer.path) >= self._frame_bytes + _SPARE

    def _disk_full_message(self) -> str:
        return (
            f"the disk of {self._writer.path} is full. Make space: the run goes on by itself, "
            "and no frame is lost"
        )


def _require_full(error: OSError) -> None:
    """Raise any other error than that the disk, or somebody's share of it, is full."""
    if error.errno not in _FULL:
        raise error
