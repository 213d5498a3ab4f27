"""A person at the window, who clicks, types and looks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from eyes import pixels
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QCursor
from PySide6.QtWidgets import QAbstractSpinBox, QComboBox, QLineEdit, QTableView, QWidget
from waits import PATIENCE, wait_until
from window_bench import Bench

from labapp.window.commit_fields import CommitComboBox


class Person:
    """Clicks, types and looks at one window; nothing is done behind the window's back."""

    def __init__(self, bench: Bench, qtbot: Any) -> None:
        self.window, self._bench, self._qtbot = bench.window, bench, qtbot

    def waits(self, seen: Callable[[], bool], *, patience: float = PATIENCE) -> None:
        __tracebackhide__ = True
        wait_until(seen, self._bench.describe, patience=patience)

    def clicks(self, widget: QWidget) -> None:
        self.waits(lambda: widget.isVisible() and widget.isEnabled())
        self._qtbot.mouseClick(widget, Qt.MouseButton.LeftButton)

    def presses(self, key: Qt.Key) -> None:
        self.window.activateWindow()
        self.waits(self.window.isActiveWindow)
        self._qtbot.keyClick(self.window, key)

    def types(self, field: QAbstractSpinBox | QLineEdit, text: str) -> None:
        field.setFocus()
        field.selectAll()
        self._qtbot.keyClicks(field, text)
        self._qtbot.keyClick(field, Qt.Key.Key_Return)

    def chooses(self, box: QComboBox, text: str) -> None:
        for _ in range(box.count()):
            self._qtbot.keyClick(box, Qt.Key.Key_Up)
        while box.currentText() != text:
            before = box.currentIndex()
            self._qtbot.keyClick(box, Qt.Key.Key_Down)
            assert box.currentIndex() != before, f"{text} is not in the list"
        if isinstance(box, CommitComboBox):
            self._qtbot.keyClick(box, Qt.Key.Key_Return)

    def cancels(self) -> None:
        """Press Esc, and answer the question whether the run is really to be cancelled."""
        self.presses(Qt.Key.Key_Escape)
        self.clicks(self.window.question.yes_button)

    def selects(self, table: QTableView, row: int) -> None:
        place = table.visualRect(table.model().index(row, 0)).center()
        self._qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=place)

    def moves_mouse(self, widget: QWidget, place: QPoint) -> None:
        QCursor.setPos(widget.mapToGlobal(place))

    def looks_at(self, widget: QWidget) -> np.ndarray:
        """The pixels that are really on the screen there, (rows, columns, 3)."""
        return pixels(widget)

    def shows(self, kind: str) -> None:
        """Choose a kind of pattern and put it on the SLM."""
        self.chooses(self.window.pattern.form.kind, kind)
        self.clicks(self.window.pattern.show_button)
