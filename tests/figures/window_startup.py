"""`python window_startup.py BEGAN`: how long the window takes to appear, and its memory.

BEGAN: the monotonic time at which this process was started. It opens the window as `labapp gui`
would, notes when it was first painted and when the first live picture was, prints one JSON line,
and closes.
"""

from __future__ import annotations

import sys

from labapp.window.app import open_window


def report_on_window(began: float) -> None:
    """Open a window, report on it, and return when it is closed; SystemExit if its bench fails."""
    application, window, connection = open_window()
    from figures.picture_watcher import run_watched
    from figures.startup_watcher import StartupWatcher

    run_watched(application, connection, StartupWatcher(window, began))


if __name__ == "__main__":
    report_on_window(float(sys.argv[1]))
