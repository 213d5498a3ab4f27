"""Clicks through patterns in a window, and notes when something of each was painted."""

from __future__ import annotations

import json
import time

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QObject, QTimer

from figures.picture_watcher import PictureWatcher
from labapp.window.main_window import MainWindow
from labapp.window.messages import LivePicture, PictureAwaited

_AVERAGED = 16
"""Frames whose mean is the exact picture that a prediction is compared with."""

_REST = 1500
"""Milliseconds between a picture and the next pattern, for the preview to be computed."""


class ChangeWatcher(PictureWatcher):
    """Clicks through the patterns, notes what is painted when, and closes the window at the end."""

    def __init__(self, window: MainWindow, began: float, kinds: list[str]) -> None:
        super().__init__(window)
        self._clicked, self._kinds = began, kinds
        self._moments: dict[str, float] = {}
        self._found: list[dict[str, float]] = []
        self._prediction: NDArray[np.uint16] | None = None
        self._sum: NDArray[np.float64] | None = None
        self._frames, self._request = 0, 0
        window.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint:
            self._note("window")
        return False

    def hear(self, report: object) -> None:
        super().hear(report)
        if isinstance(report, PictureAwaited) and report.request > self._request:
            self._note("busy")

    def note_picture(self, picture: LivePicture) -> None:
        if picture.is_prediction:
            self._note("prediction")
            self._prediction = picture.frame.image.copy()
        elif picture.request > self._request:
            self._note("exact")
            self._add(picture)

    def _note(self, name: str) -> None:
        """The event is handled after this; what a person sees is there once it was."""
        QTimer.singleShot(
            0, lambda: self._moments.setdefault(name, time.monotonic() - self._clicked)
        )

    def _add(self, picture: LivePicture) -> None:
        image = picture.frame.image.astype(np.float64)
        self._sum = image if self._sum is None else self._sum + image
        self._frames += 1
        if self._frames == _AVERAGED:
            self._request = picture.request
            self._finish()

    def _finish(self) -> None:
        assert self._sum is not None
        if self._prediction is not None:
            black = 64.0
            exact = self._sum / self._frames - black
            away = np.linalg.norm(self._prediction - black - exact)
            self._moments["prediction_error"] = float(away / np.linalg.norm(exact))
        self._found.append(self._moments)
        self._prediction = self._sum = None
        self._frames = 0
        QTimer.singleShot(_REST, self._next)

    def _next(self) -> None:
        if not self._kinds:
            print(json.dumps(self._found), flush=True)
            self._window.close()
            return
        panel = self._window.pattern
        panel.form.kind.setCurrentText(self._kinds.pop(0))
        self._moments = {}
        self._clicked = time.monotonic()
        panel.show_button.click()
