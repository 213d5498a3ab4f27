"""Fields that set hardware: a value counts only once the person has set it.

Stepping, scrolling and typing only propose a value, which is shown as pending. Enter, a click on an
arrow, or a click on an item of the open list sets it. Esc, leaving the field and a drag take it
back.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QEvent, QObject, QPoint, Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import QApplication, QComboBox, QWidget

from labapp.window.number_fields import MENU_REASONS, NumberBox, number_fields
from labapp.window.widgets import mark_property

PRESSES = (QEvent.Type.MouseButtonPress, QEvent.Type.MouseButtonDblClick)
"""Events in which a button of the mouse goes down; the second of two clicks has its own."""

_ENTER = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


class _CommitInput(QWidget if TYPE_CHECKING else object):  # type: ignore[misc]
    """Let keys and wheel only propose a value; Enter sets it.

    Stands before a Qt class among the bases. Esc and leaving the field take the value back.
    """

    @property
    def is_pending(self) -> bool:
        """Return whether the field shows a value that isn't set."""
        raise NotImplementedError

    def take_back(self) -> None:
        """Show the value that is set again, in place of a pending one."""
        raise NotImplementedError

    def _enter(self) -> None:
        """Set what the field shows."""
        raise NotImplementedError

    def _proposing(self) -> AbstractContextManager[None]:
        """Return the block in which changes only propose a value."""
        raise NotImplementedError

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ShortcutOverride and _takes_escape(self, event):
            return True
        return super().event(event)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        if event.reason() not in MENU_REASONS:
            self.take_back()
        super().focusOutEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in _ENTER:
            self._enter()
            leave_field(self)
        elif event.key() == Qt.Key.Key_Escape and self.is_pending:
            self.take_back()
        else:
            with self._proposing():
                super().keyPressEvent(event)

    def wheelEvent(self, event: QWheelEvent) -> None:
        with self._proposing():
            super().wheelEvent(event)


class CommitSpinBox(_CommitInput, NumberBox):
    """Let the person set a number of the bench.

    `committed` is emitted with a number that the person has set, and `pending_changed` with
    whether the field shows one that isn't set. `set_value` is the number that was set last;
    setValue() from the program sets it, too, and emits nothing.
    """

    committed = Signal(float)
    pending_changed = Signal(bool)

    def __init__(self, parent: QWidget | None = None, **properties: Any) -> None:
        super().__init__(parent, **properties)
        self.set_value = self.value()
        self._by_person = self._typed = self._is_pending = self._just_entered = False
        self._pressed_at, self._before_press = QPoint(), self.set_value
        self.valueChanged.connect(self._note)
        self.lineEdit().textEdited.connect(self._note_text)
        self.lineEdit().installEventFilter(self)

    @property
    def is_pending(self) -> bool:
        return self._typed or self.value() != self.set_value

    def show_value(self, value: float) -> None:
        """Show a number as the one that is set."""
        self._typed = False
        self.setValue(value)
        self.set_value = self.value()
        self._mark()

    def take_back(self) -> None:
        self.show_value(self.set_value)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Leave the field after a drag over its text: only a click enters it."""
        if isinstance(event, QMouseEvent):
            if event.type() in PRESSES:
                self._pressed_at = event.globalPosition().toPoint()
            elif event.type() == QEvent.Type.MouseButtonRelease:
                if self._just_entered and was_dragged(self._pressed_at, event):
                    self.lineEdit().deselect()
                    leave_field(self)
                self._just_entered = False
        return super().eventFilter(watched, event)

    def focusInEvent(self, event: QFocusEvent) -> None:
        self._just_entered = event.reason() == Qt.FocusReason.MouseFocusReason
        super().focusInEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        # An arrow that is held goes on stepping until it is released.
        self._pressed_at, self._before_press = event.globalPosition().toPoint(), self.value()
        self._by_person = True
        super().mousePressEvent(event)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        super().mouseReleaseEvent(event)
        if was_dragged(self._pressed_at, event):
            self.setValue(self._before_press)
        elif self.value() != self._before_press:
            self._commit()
            leave_field(self)
        self._by_person = False
        self._mark()

    @contextmanager
    def _proposing(self) -> Iterator[None]:
        """Take changes within the block for the person's, which only propose a number."""
        self._by_person = True
        try:
            yield
        finally:
            self._by_person = False
            self._mark()

    def _note(self, value: float) -> None:
        if not self._by_person:
            self.set_value = value
        self._mark()

    def _note_text(self) -> None:
        self._typed = True
        self._mark()

    def set_proposal(self) -> bool:
        """Set the number that the field shows; return False if its text is refused."""
        if self._typed and self.fault:
            self.refuse(self.lineEdit().text())
            self.take_back()
            return False
        with self._proposing():
            self.interpretText()
        self._commit()
        return True

    def _enter(self) -> None:
        self.set_proposal()

    def _commit(self) -> None:
        if self.is_pending:
            self._typed, self.set_value = False, self.value()
            self.committed.emit(self.set_value)
        self._mark()

    def _mark(self) -> None:
        self._is_pending = _show_pending(self, self._is_pending)


class CommitComboBox(_CommitInput, QComboBox):
    """Let the person choose a setting of the bench from a list.

    `committed` is emitted with an item that the person has set, and `pending_changed` with
    whether the field shows one that isn't set. `set_text` is the item that was set last.
    """

    committed = Signal(str)
    pending_changed = Signal(bool)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.set_text = ""
        self._by_key = self._is_pending = False
        self._pressed_at = QPoint()
        self.activated.connect(self._choose)

    @property
    def is_pending(self) -> bool:
        return self.currentText() != self.set_text

    def show_text(self, text: str) -> None:
        """Show an item as the one that is set; without such an item, none is."""
        self.setCurrentIndex(self.findText(text))
        self.set_text = self.currentText()
        self._mark()

    def take_back(self) -> None:
        self.show_text(self.set_text)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Wait for the release: a drag that begins on the field must not open its list."""
        self._pressed_at = event.globalPosition().toPoint()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        inside = self.rect().contains(event.position().toPoint())
        if event.button() != Qt.MouseButton.LeftButton or not inside:
            return
        if was_dragged(self._pressed_at, event):
            leave_field(self)
        else:
            self.showPopup()

    @contextmanager
    def _proposing(self) -> Iterator[None]:
        """Take a choice within the block for a proposal, since the list isn't open."""
        self._by_key = True
        try:
            yield
        finally:
            self._by_key = False
            self._mark()

    def _choose(self) -> None:
        if self._by_key:
            self._mark()
        else:
            self._commit(again=True)
            leave_field(self)

    def _enter(self) -> None:
        self._commit()

    def _commit(self, *, again: bool = False) -> None:
        if self.currentText() and (again or self.is_pending):
            self.set_text = self.currentText()
            self.committed.emit(self.set_text)
        self._mark()

    def _mark(self) -> None:
        self._is_pending = _show_pending(self, self._is_pending)


CommitField = CommitSpinBox | CommitComboBox


def leave_field(field: QWidget) -> None:
    """Give the focus from a field to the window, where keys set nothing."""
    if field.window().focusWidget() is field:
        field.window().setFocus()


def finish_typing(window: QWidget, *, proposals: bool = False) -> bool:
    """Set what is typed into a window's fields; return False if a field has refused its text.

    Numbers that hardware obeys are set only with `proposals`, as by Enter.
    """
    is_done = True
    for field in number_fields(window):
        if not isinstance(field, CommitSpinBox):
            is_done &= field.finish_typing()
        elif proposals and field.is_pending:
            is_done &= field.set_proposal()
    return is_done


def was_dragged(pressed_at: QPoint, event: QMouseEvent) -> bool:
    """Return whether the mouse moved from a press, in pixels of the screen, to this release."""
    moved = event.globalPosition().toPoint() - pressed_at
    return moved.manhattanLength() >= QApplication.startDragDistance()


def _takes_escape(field: _CommitInput, event: QEvent) -> bool:
    """Accept Esc for a field that has something to take back."""
    if not isinstance(event, QKeyEvent) or event.key() != Qt.Key.Key_Escape:
        return False
    if not field.is_pending:
        return False
    event.accept()
    return True


def _show_pending(field: CommitField, before: bool) -> bool:
    """Mark a field whose value isn't set, and return whether it isn't."""
    pending = field.is_pending
    mark_property(field, "pending", pending)
    if pending != before:
        field.pending_changed.emit(pending)
    return pending
