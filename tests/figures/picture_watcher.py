"""A watcher of a window whose process is measured, and the way such a process runs."""

from __future__ import annotations

import sys

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QApplication

from labapp.window.engine_connection import EngineConnection
from labapp.window.main_window import MainWindow
from labapp.window.messages import FailureReport, LivePicture, OpeningFailed


class PictureWatcher(QObject):
    """Hears what the engine reports, and ends the process with 1 if that is a failure."""

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._window = window

    def hear(self, report: object) -> None:
        if isinstance(report, OpeningFailed | FailureReport):
            print(report.message, file=sys.stderr)
            QApplication.exit(1)
        if isinstance(report, LivePicture):
            self.note_picture(report)

    def note_picture(self, picture: LivePicture) -> None:
        """A live picture, or a prediction of one, came."""
        raise NotImplementedError


def run_watched(
    application: QApplication, connection: EngineConnection, watcher: PictureWatcher
) -> None:
    """Run an open window until its watcher closes it; SystemExit if its bench fails."""
    connection.report_received.connect(watcher.hear)
    if status := application.exec():
        sys.exit(status)
