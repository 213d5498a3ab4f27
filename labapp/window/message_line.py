"""The line at the bottom of the window: what happens, and beside it the last error."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QSizePolicy, QWidget

from labapp.window.elided_label import ElidedLabel
from labapp.window.theme import ALARM, ALARM_TEXT, FAINT, PANEL
from labapp.window.widgets import fill_layout

ERROR_SIGN = "✖"
"""Stands before an error, so that it isn't told by its colour alone."""


class MessageLine(QWidget):
    """Show the last message, and beside it the last error until the person acknowledges it.

    A message is never hidden by an error. `said` is emitted with every text, and whether it is an
    error. `restart_requested` is emitted when the person wants a new engine, `log_requested` when
    the person wants to read all messages.
    """

    said = Signal(str, bool)
    restart_requested = Signal()
    log_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("messageLine")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._message = ElidedLabel(self, lines=2)
        self._error = ElidedLabel(self, lines=2)
        self._error.setObjectName("error")
        for label in (self._message, self._error):
            label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        # The line always has the height of two, so that nothing moves when an error comes.
        self.setFixedHeight(2 * self.fontMetrics().lineSpacing() + 10)
        self.accept = QPushButton("Acknowledge", self)
        self.accept.setToolTip("Take the error off this line; the log keeps it")
        self.restart = QPushButton("Restart engine", self)
        self.accept.clicked.connect(self.acknowledge)
        self.restart.clicked.connect(self.restart_requested)
        self._errors = 0
        parts = (self._error, 3), self.accept, self.restart, (self._message, 2)
        fill_layout(QHBoxLayout(self), *parts, margins=(10, 1, 10, 1))
        self.restart.hide()
        self._paint()

    @property
    def text(self) -> str:
        """Return the error that stands, or else the last message."""
        return self._last_error if self.is_error else self.message

    @property
    def message(self) -> str:
        return self._message.text()

    @property
    def is_error(self) -> bool:
        return self._errors > 0

    def show_message(self, text: str) -> None:
        self._message.setText(text)
        self.said.emit(text, False)

    def show_error(self, text: str, *, restart: bool = False) -> None:
        """Show an error until it is acknowledged; `restart` offers a new engine."""
        self._errors += 1
        before = f"({self._errors - 1} before it: see the log)  " if self._errors > 1 else ""
        self._last_error = text
        self._error.setText(f"{ERROR_SIGN} {before}{text}")
        if restart:
            self.restart.show()
        self._paint()
        self.said.emit(text, True)

    def acknowledge(self) -> None:
        self._errors = 0
        self._paint()

    def clear_engine_failure(self) -> None:
        self.restart.hide()
        self.acknowledge()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Acknowledge an error that is clicked; without one, ask for the log."""
        if self.is_error:
            self.acknowledge()
        else:
            self.log_requested.emit()

    def _paint(self) -> None:
        for one in (self._error, self.accept):
            one.setVisible(self.is_error)
        background = ALARM if self.is_error else PANEL
        self.setStyleSheet(
            f"QWidget#messageLine {{ background: {background}; }}"
            f"QLabel {{ color: {ALARM_TEXT if self.is_error else FAINT}; }}"
            "QLabel#error { font-weight: bold; }"
        )
