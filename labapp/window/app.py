"""The command `labapp gui`: run the process of the window."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from typing import TYPE_CHECKING, Unpack

from labapp.common.errors import UserError
from labapp.common.memory import lasting_objects
from labapp.window.bench_options import BenchOptions
from labapp.window.started_engine import StartedEngine, start_engine

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication

    from labapp.window.engine_connection import EngineConnection
    from labapp.window.main_window import MainWindow


def main(**options: Unpack[BenchOptions]) -> int:
    """Run the window on a bench until it is closed, and return the exit status.

    It is 0 only if the bench was left safe. Without a bench file, the window opens on the virtual
    bench.
    """
    application, _window, connection = open_window(**options)
    code = application.exec()
    connection.close()
    return code or int(connection.has_failed)


def open_window(
    **options: Unpack[BenchOptions],
) -> tuple[QApplication, MainWindow, EngineConnection]:
    """Start the engine, load the window meanwhile, and show it.

    Only the engine's process imports heavy libraries. Raises UserError if there is no display.
    options: files of the bench, of the scene, of the image, and of faults that are injected into
        simulated devices, and the memory for simulated pictures.
    """
    _require_display()
    # Ctrl-C in the terminal ends the window at once; the engine then makes the bench safe.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    engine: StartedEngine | None = None
    with contextlib.suppress(OSError):  # The connection tries again, and tells why.
        engine = start_engine(options)
    with lasting_objects():
        from PySide6.QtWidgets import QApplication

        from labapp.window import theme
        from labapp.window.engine_connection import EngineConnection
        from labapp.window.main_window import MainWindow
        from labapp.window.remembered_settings import RememberedSettings, default_settings_file

        application = QApplication(sys.argv[:1])
        application.setApplicationName("labapp")
        theme.apply_theme(application)
        connection = EngineConnection(engine, **options)
        window = MainWindow(connection, RememberedSettings(default_settings_file()))
    window.show()
    connection.start()
    return application, window, connection


def _require_display() -> None:
    """Raise UserError if there is no display; Qt would abort the process without a hint."""
    known = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in known):
        raise UserError(
            "There is no display to open the window on. Start it from a desktop session or "
            "through `ssh -X`; without a display, use `labapp run` or `labapp demo`."
        )
