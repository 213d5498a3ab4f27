"""A guard that keeps stray wheel turns, letters and drags from acting on widgets."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QEvent, QObject, QPoint, Qt, QTimer
from PySide6.QtGui import QKeyEvent, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSpinBox,
    QCheckBox,
    QComboBox,
    QSlider,
    QToolButton,
    QWidget,
)
from shiboken6 import isValid

from labapp.window.actions import Action
from labapp.window.commit_fields import PRESSES, finish_typing, leave_field, was_dragged
from labapp.window.number_fields import number_fields
from labapp.window.widgets import BEGINS, STOPS

_WHEEL_FIELDS = (QAbstractSpinBox, QComboBox, QSlider)
"""Widgets whose value the wheel changes, in Qt also where the mouse only passes over them."""

_LISTS = (QComboBox, QAbstractItemView)
"""Widgets in which a letter searches. Qt gives it to a shortcut of the window instead."""

_COMMANDS = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier
"""Keys that make a letter a command."""


class InputGuard(QObject):
    """Watch all fields, lists and buttons of a window.

    The wheel changes a field only if the field has the focus and Ctrl is held; else it scrolls
    what the field lies in. Letters typed in a list search there. A button that the mouse was
    dragged over isn't clicked, nor one that is pressed while a typed text can't be set, unless it
    stops something. A click leaves the focus neither on it, where Space would click it again, nor
    in the field that had it.
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
            return isinstance(watched, _LISTS) and self._keeps_letter(event)
        if isinstance(watched, QAbstractButton) and isinstance(event, QMouseEvent):
            self._watch_drag(watched, event)
            if event.type() == QEvent.Type.MouseButtonRelease and watched.isDown():
                QTimer.singleShot(0, partial(_leave, watched.window().focusWidget()))
            if not _always_clicks(watched):
                return self._waits(watched, event)
        return False

    def _waits(self, button: QAbstractButton, event: QMouseEvent) -> bool:
        """Return whether a button isn't pressed or released, since a typed text was refused.

        It was by this click, or by the focus that left its field just before.
        """
        if event.type() in PRESSES:
            return not finish_typing(button.window()) or self._refused
        released = event.type() == QEvent.Type.MouseButtonRelease and button.isDown()
        if released and button.property(BEGINS) and button.hitButton(event.position().toPoint()):
            button.setDown(finish_typing(button.window(), proposals=True))
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


def _leave(field: QWidget | None) -> None:
    """Give the focus from a field to the window, unless the click has moved it."""
    if field is not None and isValid(field):
        leave_field(field)


def _always_clicks(button: QAbstractButton) -> bool:
    """Return whether a button stops something, or is an action's, which may wait."""
    of_action = isinstance(button, QToolButton) and isinstance(button.defaultAction(), Action)
    return of_action or bool(button.property(STOPS))
