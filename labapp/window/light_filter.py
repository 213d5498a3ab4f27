"""Dimmed or red windows, for eyes that are adapted to a dark laboratory.

Red light spares the rods of the eye, which see in the dark and hardly respond beyond 620 nm (CIE
1951 scotopic luminosity function).
"""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import QApplication, QWidget
from shiboken6 import isValid

_DIM = 0.45
"""Share of its light that a dimmed window keeps, in values of the screen. Chosen."""


class LightFilter(QObject):
    """Multiply all that the application shows by a colour, pictures and dialogues too.

    `dim` takes away light of all colours, and `red` leaves red alone. Colours that differ by their
    green and blue only look alike in red light; signs and words tell them apart.
    """

    def __init__(self, application: QApplication, parent: QObject) -> None:
        super().__init__(parent)
        self._application = application
        self._colour = QColor(Qt.GlobalColor.white)
        self._panes: list[_Pane] = []

    def set_light(self, *, dim: bool, red: bool) -> None:
        """Set the light of all windows of the application, those that open later included."""
        share = round(255 * (_DIM if dim else 1.0))
        self._colour = QColor(share, 0 if red else share, 0 if red else share)
        for pane in self._living_panes():
            pane.remove()
        self._panes = []
        # A filter sees every event, so that there is none while nothing is filtered.
        self._application.removeEventFilter(self)
        if dim or red:
            self._application.installEventFilter(self)
            for window in self._application.topLevelWidgets():
                # Menus that wait to be opened are covered then.
                if window.isVisible():
                    self._cover(window)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if (
            event.type() == QEvent.Type.Show
            and isinstance(watched, QWidget)
            and watched.isWindow()
            and not any(pane.is_before(watched) for pane in self._living_panes())
        ):
            self._cover(watched)
        return False

    def _cover(self, window: QWidget) -> None:
        self._panes = [*self._living_panes(), _Pane(window, self._colour)]

    def _living_panes(self) -> list[_Pane]:
        """Return the panes of windows that still exist.

        They are asked, since PySide can crash where a pane's own end calls Python.
        """
        return [pane for pane in self._panes if isValid(pane)]


class _Pane(QWidget):
    """A pane of coloured glass before one window, which keyboard and mouse pass through.

    It keeps no reference to the window: Python would collect the two as a cycle, which crashes.
    """

    def __init__(self, window: QWidget, colour: QColor) -> None:
        super().__init__(window)
        self._colour = colour
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setAttribute(Qt.WidgetAttribute.WA_NoSystemBackground)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        window.installEventFilter(self)
        self.setGeometry(window.rect())
        self.show()

    def is_before(self, window: QWidget) -> bool:
        """Return whether this pane covers a window of the application."""
        return self.parentWidget() is window

    def remove(self) -> None:
        if (window := self.parentWidget()) is not None:
            window.removeEventFilter(self)
        self.hide()
        self.deleteLater()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        shown = event.type() in (QEvent.Type.Resize, QEvent.Type.ChildPolished, QEvent.Type.Show)
        if shown and isinstance(watched, QWidget):
            self.setGeometry(watched.rect())
            self.raise_()
        return False

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Multiply)
        painter.fillRect(event.rect(), self._colour)
        painter.end()
