"""`python live_window.py BEGAN SECONDS BENCH SCENE`: a live window, and what its process costs.

BEGAN: the monotonic time at which this process was started. It opens the window, prints the place
of the picture on the screen as a JSON line once some frames were shown, lets it live for SECONDS,
prints another JSON line, and closes.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from PySide6.QtCore import QPoint, QTimer

from figures.picture_watcher import PictureWatcher, run_watched
from labapp.window.app import open_window
from labapp.window.main_window import MainWindow
from labapp.window.messages import LivePicture

_WARM_UP = 30
"""Frames before the measurement: the first ones meet memory that nobody has used yet."""


class _Meter(PictureWatcher):
    """Counts frames and processor time of the window's process, and closes it at the end."""

    def __init__(self, window: MainWindow, began: float, seconds: float) -> None:
        super().__init__(window)
        self._began, self._seconds = began, seconds
        self._frames = 0
        self._moments: dict[str, float] = {}

    def note_picture(self, picture: LivePicture) -> None:
        self._frames += 1
        self._last = picture
        self._moments.setdefault("first_picture_s", time.monotonic() - self._began)
        if self._frames == _WARM_UP:
            self._start()

    def _start(self) -> None:
        picture = self._window.live_view.picture
        corner = picture.mapToGlobal(QPoint(0, 0))
        place = [corner.x(), corner.y(), picture.width(), picture.height()]
        print(json.dumps({"place": place}), flush=True)
        self._cpu, self._wall = time.process_time(), time.monotonic()
        QTimer.singleShot(round(self._seconds * 1e3), self._finish)

    def _finish(self) -> None:
        frames = self._frames - _WARM_UP
        found = self._moments | {
            "frames": frames,
            "frames_per_s": frames / (time.monotonic() - self._wall),
            "window_cpu_ms": 1e3 * (time.process_time() - self._cpu) / max(frames, 1),
            "dropped": self._last.dropped,
            "missed": self._last.missed,
        }
        print(json.dumps(found), flush=True)
        self._window.close()


def live_window(began: float, seconds: float, bench: Path, scene: Path) -> None:
    """Open a window on a bench's files, and report on it; SystemExit if its bench fails."""
    application, window, connection = open_window(bench=bench, scene=scene)
    run_watched(application, connection, _Meter(window, began, seconds))


if __name__ == "__main__":
    live_window(float(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3]), Path(sys.argv[4]))
