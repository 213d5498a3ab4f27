"""`labapp gui`: the window's process, from start to end."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from PySide6.QtWidgets import QApplication

from labapp.common.errors import UserError
from labapp.window import theme
from labapp.window.engine_connection import EngineConnection
from labapp.window.main_window import MainWindow
from labapp.window.remembered_settings import RememberedSettings, default_settings_file


def main(**files: Path | None) -> int:
    """Open the window on a bench, the virtual one if no file is given; the exit status."""
    application, _window, _connection = open_window(**files)
    return int(application.exec())


def open_window(**files: Path | None) -> tuple[QApplication, MainWindow, EngineConnection]:
    """The window on the screen, and its engine on the way.

    files: bench, scene, image, and faults that simulated devices shall suffer. Nothing heavy is
    imported here: the engine's process loads it once the window is shown. UserError if there is
    no display.
    """
    _require_display()
    # Ctrl-C in the terminal ends the window at once; the engine then makes the bench safe.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    application = QApplication(sys.argv[:1])
    application.setApplicationName("labapp")
    theme.apply_theme(application)
    connection = EngineConnection(**files)
    window = MainWindow(connection, RememberedSettings(default_settings_file()))
    window.show()
    connection.start()
    return application, window, connection


def _require_display() -> None:
    """Qt ends the process with an abort where there is no display; say it in words first."""
    known = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in known):
        raise UserError(
            "There is no display to open the window on. Start it from a desktop session or "
            "through `ssh -X`; without a display, use `labapp run` or `labapp demo`."
        )
