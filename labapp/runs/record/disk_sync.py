"""Bring written bytes to the disk, and tell which frames it didn't take.

Written bytes stay in the operating system's memory for up to half a minute, and a power cut takes
them. fdatasync(2) waits until they are on the disk. Where it fails, Linux counts the bytes as
written although they are lost, so that asking again would succeed: the frames are given up instead.
"""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Sequence
from contextlib import suppress

from labapp.files.frame_list import format_frame_list
from labapp.files.writing import sync_handle

EVERY = 1.0
"""Seconds between two syncs. Chosen: a power cut takes the frames of at most two seconds."""


class LostWrites(OSError):
    """The disk refused bytes that it had taken before.

    frames: those that may be lost with them.
    """

    def __init__(self, error: OSError, frames: Sequence[int]) -> None:
        which = f"frames {format_frame_list(frames)}" if frames else "the end of the record"
        super().__init__(errno.EIO, f"the disk didn't keep what was written: {which} may be lost")
        self.frames = sorted(set(frames))
        self.__cause__ = error

    def __str__(self) -> str:
        remedy = "Look at the disk, then take them again with: labapp resume"
        return f"{self.strerror}. {remedy}"


class DiskSync:
    """Synchronises a file about each second, in a thread of its own.

    It has a handle of its own, because an error is told once to each open file, and never to one
    that was opened after it.
    """

    def __init__(self, path: str) -> None:
        self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        self._turn = threading.Lock()
        self._written: list[int] = []
        self._failed: LostWrites | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="disk sync", daemon=True)
        self._thread.start()

    def note_frame(self, index: int) -> None:
        """Note that a frame was written; raise LostWrites if the disk loses some."""
        self._written.append(index)
        self._require_kept()

    def flush(self) -> None:
        """Return when all is on the disk; raise LostWrites if it can't be."""
        with self._turn:
            if self._failed is not None:
                # The marks of the frames that are given up may be kept.
                with suppress(OSError):
                    sync_handle(self._handle)
                self._require_kept()
            frames, self._written = self._written, []
            try:
                sync_handle(self._handle)
            except OSError as error:
                self._failed = LostWrites(error, frames)
                raise self._failed from error

    def _require_kept(self) -> None:
        """Raise LostWrites if the disk has lost something, with all frames since then."""
        if self._failed is not None:
            frames, self._written = self._written, []
            self._failed = LostWrites(self._failed, [*self._failed.frames, *frames])
            raise self._failed

    def close(self) -> None:
        """End the thread; nothing is synchronised any more."""
        self._ended.set()
        self._thread.join()
        with self._turn:
            if self._handle >= 0:
                os.close(self._handle)
                self._handle = -1

    def _work(self) -> None:
        while not self._ended.wait(EVERY):
            if self._written:
                try:
                    self.flush()
                except LostWrites:
                    return
