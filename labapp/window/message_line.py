"""The message line at the bottom of the window, where an error stays until it is clicked."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QSizePolicy, QWidget

from labapp.window.theme import ALARM, ALARM_TEXT, FAINT, PANEL
from labapp.window.widgets import fill_layout, make_label, plain_tip


class MessageLine(QWidget):
    """Show messages and errors at the bottom of the window.

    `restart_requested` is emitted when the person wants a new engine.
    """

    restart_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("messageLine")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._label = make_label(self, wrap=True)
        self._label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        # The line always has the height of two, so that nothing moves when an error comes.
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
        """Show a message in the window, or keep it until a standing error is acknowledged."""
        self._said = text
        if not self.is_error:
            self._label.setText(text)

    def show_error(self, text: str, *, restart: bool = False) -> None:
        """Show an error in the window until it is clicked; `restart` offers a new engine."""
        self._errors += 1
        more = f"  (and {self._errors - 1} before it)" if self._errors > 1 else ""
        self._label.setText(text + more)
        self._label.setToolTip(plain_tip(text))
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
