"""The log: every message and error since the window opened, each with its time."""

from __future__ import annotations

from datetime import datetime

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QTextCharFormat, QTextCursor
from PySide6.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QPlainTextEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from labapp.window.message_line import ERROR_SIGN
from labapp.window.theme import ERROR, TEXT
from labapp.window.widgets import PANEL_MARGINS, fill_layout

_KEPT = 2000
"""Messages that the log keeps. Chosen: days of work, in less than a megabyte."""


class LogPanel(QWidget):
    """List messages and errors in their order; the person can copy them, or see errors only."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.view = QPlainTextEdit(self)
        self.view.setReadOnly(True)
        self.view.setMaximumBlockCount(_KEPT)
        self.view.setTabChangesFocus(True)
        self.view.setPlaceholderText("Messages and errors are listed here.")
        self.view.setTextInteractionFlags(
            Qt.TextInteractionFlag.TextSelectableByMouse
            | Qt.TextInteractionFlag.TextSelectableByKeyboard
        )
        self.errors_only = QCheckBox("Errors only", self)
        self.copy = QPushButton("Copy all", self)
        self.copy.setToolTip("Put the log into the clipboard")
        self._entries: list[tuple[str, bool]] = []
        self.errors_only.toggled.connect(lambda _: self._show_all())
        self.copy.clicked.connect(self._copy)
        below = fill_layout(QHBoxLayout(), self.errors_only, 1, self.copy)
        fill_layout(QVBoxLayout(self), (self.view, 1), below, margins=PANEL_MARGINS, spacing=4)

    @property
    def lines(self) -> list[str]:
        """Return what the log shows, line by line."""
        return self.view.toPlainText().splitlines()

    def add_message(self, text: str, is_error: bool) -> None:
        """Add a message or an error, with the time of day."""
        sign = ERROR_SIGN if is_error else "·"
        entry = f"{datetime.now():%H:%M:%S} {sign} {' '.join(text.split())}", is_error
        self._entries = [*self._entries[1 - _KEPT :], entry]
        self._append(entry)

    def _show_all(self) -> None:
        self.view.clear()
        for entry in self._entries:
            self._append(entry)

    def _append(self, entry: tuple[str, bool]) -> None:
        text, is_error = entry
        if self.errors_only.isChecked() and not is_error:
            return
        form = QTextCharFormat()
        form.setForeground(QColor(ERROR if is_error else TEXT))
        cursor = QTextCursor(self.view.document())
        cursor.movePosition(QTextCursor.MoveOperation.End)
        if not self.view.document().isEmpty():
            cursor.insertBlock()
        cursor.insertText(text, form)
        self.view.ensureCursorVisible()
        bar = self.view.verticalScrollBar()
        bar.setValue(bar.maximum())

    def _copy(self) -> None:
        self.view.selectAll()
        self.view.copy()
