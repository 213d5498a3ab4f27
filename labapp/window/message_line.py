"""The line at the bottom: the last error stays until somebody has clicked it away."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QSizePolicy, QWidget

from labapp.window.theme import ALARM, ALARM_TEXT, FAINT, PANEL
from labapp.window.widgets import fill_layout, make_label


class MessageLine(QWidget):
    """Says what happens, and what went wrong. restart_requested: the person wants a new engine."""

    restart_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("messageLine")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._label = make_label(self, wrap=True)
        self._label.setTextFormat(Qt.TextFormat.PlainText)
        self._label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        # Two lines always, so that nothing moves when an error comes.
        self.setFixedHeight(2 * self.fontMetrics().lineSpacing() + 12)
        self._hint = make_label(self, "click to acknowledge")
        self.restart = QPushButton("Restart engine", self)
        self.restart.clicked.connect(self.restart_requested)
        self._errors = 0
        self._said = ""
        parts = (self._label, 1), self._hint, self.restart
        fill_layout(QHBoxLayout(self), *parts, margins=(10, 2, 10, 2))
        self.restart.hide()
        self._paint()

    @property
    def text(self) -> str:
        return self._label.text()

    @property
    def is_error(self) -> bool:
        return self._errors > 0

    def show_message(self, text: str) -> None:
        """News; while an error stands, it waits behind it."""
        self._said = text
        if not self.is_error:
            self._label.setText(text)

    def show_error(self, text: str, *, restart: bool = False) -> None:
        """An error, which stays until it is clicked."""
        self._errors += 1
        more = f"  (and {self._errors - 1} before it)" if self._errors > 1 else ""
        self._label.setText(text + more)
        self._label.setToolTip(text)
        if restart:
            self.restart.show()
        self._paint()

    def acknowledge(self) -> None:
        self._errors = 0
        self._label.setText(self._said)
        self._label.setToolTip("")
        self._paint()

    def clear_engine_failure(self) -> None:
        self.restart.hide()
        self.acknowledge()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if self.is_error:
            self.acknowledge()

    def _paint(self) -> None:
        colours = (ALARM, ALARM_TEXT) if self.is_error else (PANEL, FAINT)
        self._hint.setVisible(self.is_error)
        weight = "bold" if self.is_error else "normal"
        self.setStyleSheet(
            f"QWidget#messageLine {{ background: {colours[0]}; }}"
            f"QLabel {{ color: {colours[1]}; font-weight: {weight}; }}"
        )
