"""A guard that keeps stray wheel turns, letters and drags from acting on the window's widgets."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QPoint, Qt, QTimer
from PySide6.QtGui import QKeyEvent, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSpinBox,
    QCheckBox,
    QComboBox,
    QSlider,
    QWidget,
)

from labapp.window.commit_fields import PRESSES, finish_typing, was_dragged
from labapp.window.number_fields import NumberField, number_fields

_WHEEL_FIELDS = (QAbstractSpinBox, QComboBox, QSlider)
"""Widgets whose value the wheel changes, in Qt also where the mouse only passes over them."""

_LISTS = (QComboBox, QAbstractItemView)
"""Widgets in which a letter searches. Qt gives it to a shortcut of the window instead."""

_COMMANDS = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier
"""Keys that make a letter a command."""


_FUNCTION_KEYS = range(Qt.Key.Key_F1.value, Qt.Key.Key_F35.value + 1)


class InputGuard(QObject):
    """Watch all fields, lists and buttons of a window.

    The wheel changes a field only if the field has the focus and Ctrl is held; else it scrolls
    what the field lies in. Letters typed in a list search there. A button that the mouse was
    dragged over isn't clicked, nor one that is pressed while a typed text can't be set. A click
    doesn't leave the focus on it, where Space would click it again.
    """

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._pressed_at, self._refused = QPoint(), False
        self.watch(window)

    def watch(self, part: QWidget) -> None:
        """Watch the fields, lists and buttons in a part of the window, also one made later."""
        for field in part.findChildren(QWidget):
            if isinstance(field, _WHEEL_FIELDS):
                field.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            if isinstance(field, QAbstractButton) and not isinstance(field, QCheckBox):
                field.setFocusPolicy(Qt.FocusPolicy.TabFocus)
            if isinstance(field, (*_WHEEL_FIELDS, *_LISTS, QAbstractButton)):
                field.installEventFilter(self)
        for number in number_fields(part):
            number.refused.connect(self._note_refusal)
        for box in part.findChildren(QComboBox):
            box.view().installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QWheelEvent) and isinstance(watched, _WHEEL_FIELDS):
            return self._stops_wheel(watched, event)
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent):
            if isinstance(watched, NumberField):
                return self._keeps_command(watched, event)
            return isinstance(watched, _LISTS) and self._keeps_letter(event)
        if isinstance(watched, QAbstractButton) and isinstance(event, QMouseEvent):
            self._watch_drag(watched, event)
            # Nothing begins beside a typed text that was refused, by this press or by the focus
            # that left its field just before.
            if event.type() in PRESSES:
                return not finish_typing(watched.window()) or self._refused
        return False

    def _note_refusal(self) -> None:
        self._refused = True
        QTimer.singleShot(0, self._forget_refusal)

    def _forget_refusal(self) -> None:
        self._refused = False

    def _stops_wheel(self, field: QWidget, event: QWheelEvent) -> bool:
        meant = event.modifiers() & Qt.KeyboardModifier.ControlModifier
        if field.hasFocus() and meant:
            return False
        # An ignored wheel goes on to the field's parent, which may scroll.
        event.ignore()
        return True

    def _keeps_command(self, field: QWidget, event: QKeyEvent) -> bool:
        """Keep a function key from its shortcut if a field refuses what is typed into it."""
        if event.key() not in _FUNCTION_KEYS or finish_typing(field.window()):
            return False
        event.accept()
        return True

    def _keeps_letter(self, event: QKeyEvent) -> bool:
        if event.modifiers() & _COMMANDS or not event.text().isprintable() or not event.text():
            return False
        event.accept()
        return True

    def _watch_drag(self, button: QAbstractButton, event: QMouseEvent) -> None:
        if event.type() in PRESSES:
            self._pressed_at = event.globalPosition().toPoint()
        elif event.type() == QEvent.Type.MouseButtonRelease and was_dragged(
            self._pressed_at, event
        ):
            # A button that isn't down doesn't take the release for a click.
            button.setDown(False)
