"""`python window_probe.py PICTURES`: what is cut or out of reach in the window on this screen.

It opens the window as `labapp gui` would, waits for its first picture, brings every tab and panel
to the front, and prints one JSON line of the faults. PICTURES: a folder for what the screen shows,
or "" for none.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

# The package is beside this script, whose folder isn't on the path.
sys.path.insert(0, str(Path(__file__).parents[1]))

from PySide6.QtTest import QTest

from figures.window_geometry import all_faults
from labapp.window.app import open_window
from labapp.window.messages import LivePicture

_PATIENCE = 60.0
"""Seconds in which the first picture comes."""


def report_on_window(pictures: str) -> None:
    """Open a window, print what is wrong with its geometry, and end the process."""
    _, window, connection = open_window()
    came: list[LivePicture] = []
    connection.report_received.connect(
        lambda report: came.append(report) if isinstance(report, LivePicture) else None
    )
    late = time.monotonic() + _PATIENCE
    while not came and time.monotonic() < late:
        QTest.qWait(50)
    # The pattern's preview comes later, on a busy machine.
    QTest.qWait(2000)
    window.message.show_error(
        "The filter gave no reply in 2 s. Check its cable. " * 6, restart=True
    )
    screen = window.screen()
    found = all_faults(window, screen.geometry(), lambda: QTest.qWait(100))
    if pictures:
        window.message.clear_engine_failure()
        for name in ("Why", "Log", "Queue"):
            window.docks[name].raise_()
            QTest.qWait(300)
            size = f"{screen.geometry().width()}x{screen.geometry().height()}"
            screen.grabWindow(0).save(f"{pictures}/{size}-{screen.devicePixelRatio():g}-{name}.png")
    print(json.dumps({"came": len(came), "faults": found}), flush=True)
    connection.close()
    os._exit(0)


if __name__ == "__main__":
    report_on_window(sys.argv[1])
