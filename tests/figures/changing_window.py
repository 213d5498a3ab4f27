"""`python changing_window.py BEGAN BENCH SCENE KIND ...`: how soon pictures of new patterns come.

BEGAN: the monotonic time at which this process was started. It opens the window, shows patterns of
these kinds on the SLM one after the other, prints one JSON line, and closes. Moments are those at
which something was painted, in seconds after the start or after the click.
"""

from __future__ import annotations

import sys
from pathlib import Path

from labapp.window.app import open_window


def changing_window(began: float, bench: Path, scene: Path, kinds: list[str]) -> None:
    """Open a window on a bench's files, and report on it; SystemExit if its bench fails."""
    application, window, connection = open_window(bench=bench, scene=scene)
    from figures.change_watcher import ChangeWatcher
    from figures.picture_watcher import run_watched

    run_watched(application, connection, ChangeWatcher(window, began, kinds))


if __name__ == "__main__":
    began, bench, scene, *kinds = sys.argv[1:]
    changing_window(float(began), Path(bench), Path(scene), kinds)
