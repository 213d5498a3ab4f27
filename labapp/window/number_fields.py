"""Fields for numbers, which are read and shown alike under every desktop language.

A text that is no number, or one that the field can't hold, isn't set: the field says why, and shows
the value that it had.
"""

from __future__ import annotations

from decimal import Decimal
from textwrap import fill
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QPoint, Qt, QTimer, Signal
from PySide6.QtGui import QFocusEvent, QValidator
from PySide6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QSpinBox, QToolTip, QWidget

from labapp.common.plain_text import quote
from labapp.common.typed_numbers import parse_decimal
from labapp.window.widgets import mark_property, plain_tip

_TOLD_MS = 8000
"""Milliseconds for which a field's reason stays beside it; the log keeps it. Chosen."""

MENU_REASONS = (Qt.FocusReason.PopupFocusReason, Qt.FocusReason.MenuBarFocusReason)
"""Why a field is without the keyboard while a list or a menu is open."""

_TIP_WIDTH = 60
"""Characters of a line of the reason, which else is as wide as the screen."""

if TYPE_CHECKING:

    class _Spin(QAbstractSpinBox):
        """What Qt's fields for numbers and for whole numbers have alike."""

        minimum: Any
        maximum: Any
        value: Any
        setValue: Any
        decimals: Any
        prefix: Any
        suffix: Any
        valueChanged: Any
        refused: Any

else:
    _Spin = object


class _NumberInput(_Spin):
    """Read what is typed into a field by the one parser of typed numbers.

    Stands before a Qt class among the bases. `refused` is emitted with a sentence for each text
    that isn't set.
    """

    def __init__(self, parent: QWidget | None = None, **properties: Any) -> None:
        super().__init__(parent, **properties)
        # A number that is half typed sets nothing.
        self.setKeyboardTracking(False)
        self._fresh_text, self._sentence = False, ""
        self.lineEdit().textEdited.connect(self._note_typing)
        self.editingFinished.connect(self._note_end)
        self.valueChanged.connect(lambda _: mark_property(self, "refused", False))

    @property
    def places(self) -> int:
        """Return how many digits the field has after the decimal sign."""
        decimals: int = self.decimals()
        return decimals

    @property
    def fault(self) -> str:
        """Say why the field's text can't be set; "" if it can."""
        try:
            self.read_text(self.lineEdit().text())
        except ValueError as error:
            return str(error)
        return ""

    def read_text(self, text: str) -> Decimal:
        """Return the number in a text, exactly as the field can hold it.

        Raises ValueError with a sentence for a text that is no number, has more digits after the
        decimal sign than the field, or lies beyond its range.
        """
        if self.specialValueText() and text.strip() == self.specialValueText():
            return Decimal(self._written(self.minimum()))
        # A unit that is typed stands before the one that the field writes.
        bare = text.removeprefix(self.prefix()).removesuffix(self.suffix())
        number = parse_decimal(bare, self.suffix())
        unit, shown = self.suffix(), quote(bare.strip())
        low, high = self._written(self.minimum()), self._written(self.maximum())
        if not Decimal(low) <= number <= Decimal(high):
            raise ValueError(f"{shown} is out of range: type a number from {low} to {high}{unit}")
        rounded = round(number, self.places) + 0
        if rounded != number:
            near = f"type {rounded:f}{unit}, for instance"
            if self.places:
                raise ValueError(f"{shown} has more than {self.places} decimals: {near}")
            raise ValueError(f"{shown} isn't a whole number: {near}")
        return rounded

    def set_from_text(self, text: str) -> None:
        """Set the number in a text that the program kept; raise ValueError as read_text does."""
        self.setValue(type(self.value())(self.read_text(text)))

    def validate(self, text: str, place: int) -> tuple[QValidator.State, str, int]:
        """Let any text stand while it is typed, so that no key is swallowed."""
        try:
            self.read_text(text)
        except ValueError:
            return QValidator.State.Intermediate, text, place
        return QValidator.State.Acceptable, text, place

    def focusOutEvent(self, event: QFocusEvent) -> None:
        # Behind a menu the text stays as it is typed: the action that is chosen there reads it.
        if event.reason() not in MENU_REASONS:
            super().focusOutEvent(event)

    def fixup(self, text: str) -> str:
        """Refuse a text that can't be set; Qt shows the former value again."""
        if self._fresh_text:
            self.refuse(text)
        return text

    def finish_typing(self) -> bool:
        """Set what is typed; return False if the text is refused."""
        fault = self._fresh_text and bool(self.fault)
        if self._fresh_text:
            self.interpretText()
        self._fresh_text = False
        return not fault

    def refuse(self, text: str) -> None:
        """Say beside the field why a text isn't set, and what the value stays."""
        self._fresh_text = False
        try:
            self.read_text(text)
        except ValueError as error:
            kept = self.textFromValue(self.value())
            self.say(f"{error}. It stays {self.prefix()}{kept}{self.suffix()}.")

    def say(self, sentence: str) -> None:
        """Show a sentence beside the field, and tell it to who listens."""
        mark_property(self, "refused", True)
        self._sentence = sentence
        # Qt hides tips when the focus changes, as it does after Enter.
        QTimer.singleShot(0, self._show_sentence)
        self.refused.emit(sentence)

    def _show_sentence(self) -> None:
        if self.isVisible():
            below = self.mapToGlobal(QPoint(0, self.height()))
            tip = plain_tip(fill(self._sentence, _TIP_WIDTH))
            QToolTip.showText(below, tip, self, self.rect(), _TOLD_MS)

    def textFromValue(self, value: float) -> str:
        """Write a number as it is typed: with a point, and nothing between groups of digits."""
        return self._written(value)

    def _written(self, value: float) -> str:
        return f"{value:.{self.places}f}"

    def _note_end(self) -> None:
        self._fresh_text = False

    def _note_typing(self) -> None:
        self._fresh_text = True
        mark_property(self, "refused", False)


class NumberBox(_NumberInput, QDoubleSpinBox):
    """Let the person type a number."""

    refused = Signal(str)

    def valueFromText(self, text: str) -> float:
        """Return the number in a text that validate() has accepted."""
        return float(self.read_text(text))


class WholeNumberBox(_NumberInput, QSpinBox):
    """Let the person type a whole number."""

    refused = Signal(str)

    @property
    def places(self) -> int:
        return 0

    def valueFromText(self, text: str) -> int:
        """Return the whole number in a text that validate() has accepted."""
        return int(self.read_text(text))


NumberField = NumberBox | WholeNumberBox


def number_fields(part: QWidget) -> list[NumberField]:
    """Return all fields for numbers in a part of the window."""
    return [one for one in part.findChildren(QAbstractSpinBox) if isinstance(one, NumberField)]
