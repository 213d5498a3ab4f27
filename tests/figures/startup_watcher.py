"""Notes when a window was first painted and when its first pictures were, and closes it."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, QTimer

from figures.picture_watcher import PictureWatcher
from labapp.window.main_window import MainWindow
from labapp.window.messages import LivePicture

_FRAMES = 60


class StartupWatcher(PictureWatcher):
    """Notes the first paint and the first frames, prints them, and closes the window."""

    def __init__(self, window: MainWindow, began: float) -> None:
        super().__init__(window)
        self._began = began
        self._found: dict[str, float] = {}
        self._frames = 0
        window.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and "seconds_to_window" not in self._found:
            # The event is handled after this; what a person sees is there once it was.
            QTimer.singleShot(0, lambda: self._note("seconds_to_window"))
        return False

    def note_picture(self, picture: LivePicture) -> None:
        self._frames += 1
        self._note("seconds_to_picture")
        if self._frames == _FRAMES:
            self._finish()

    def _note(self, name: str) -> None:
        self._found.setdefault(name, round(time.monotonic() - self._began, 3))

    def _finish(self) -> None:
        first, now = self._found["seconds_to_picture"], time.monotonic() - self._began
        self._found["frames_per_second"] = round((_FRAMES - 1) / (now - first), 1)
        self._found["rss_mb"] = round(_resident_bytes() / 1e6, 1)
        print(json.dumps(self._found), flush=True)
        self._window.close()


def _resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
