"""`python -m labapp.window.startup`: how long the window takes to appear, and its memory.

Prints one JSON line. A child opens the window as `labapp gui` would, says when it was
first painted and when the first live picture was, and closes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, QTimer
from PySide6.QtWidgets import QMainWindow

from labapp.window.connection import Connection
from labapp.window.messages import LiveFrame

PROBE = "LABAPP_WINDOW_PROBE"
"""Environment variable: the monotonic time at which the child was started."""

_COMMAND = "import sys; from labapp.window.app import main; sys.exit(main())"
_FRAMES = 60
_LIMIT = 120


class _Watcher(QObject):
    """Notes the first paint and the first frames, prints them, and closes the window."""

    def __init__(self, window: QMainWindow, began: float) -> None:
        super().__init__(window)
        self._window, self._began = window, began
        self._found: dict[str, float] = {}
        self._frames = 0
        window.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and "seconds_to_window" not in self._found:
            # The event is handled after this; what a person sees is there once it was.
            QTimer.singleShot(0, lambda: self._note("seconds_to_window"))
        return False

    def hear(self, report: object) -> None:
        if not isinstance(report, LiveFrame):
            return
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


def watch(window: QMainWindow, connection: Connection) -> None:
    """Report on a window that was started for it, and close it."""
    watcher = _Watcher(window, float(os.environ[PROBE]))
    connection.received.connect(watcher.hear)


def measure() -> dict[str, float]:
    """Seconds from before the child's start to the first paint; resident megabytes, live."""
    environment = {**os.environ, PROBE: str(time.monotonic())}
    child = subprocess.run(
        [sys.executable, "-c", _COMMAND],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        timeout=_LIMIT,
        check=True,
    )
    return json.loads(child.stdout.strip().splitlines()[-1])


def _resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    print(json.dumps(measure()))
