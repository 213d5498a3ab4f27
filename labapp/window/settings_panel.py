"""Panel of target, wavelength and exposure, each as set and as read back."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QLabel, QWidget

from labapp.window.commit_fields import CommitComboBox, CommitSpinBox
from labapp.window.messages import BenchOpened, BenchState
from labapp.window.theme import DIFFERS_SIGN
from labapp.window.widgets import (
    PANEL_MARGINS,
    fill_layout,
    make_label,
    make_tool_button,
    mark_difference,
    mark_property,
)

_FIRST_TARGET = "photograph"

_HINT = "Enter sets it, Esc takes it back"

_READ_BACK = "read back"
"""Heading of the column of values that the devices have told."""


class SettingsPanel(QWidget):
    """Let the person set target, wavelength and exposure; its signals are in metres and seconds.

    `range_told` is emitted with a sentence where a bench's range doesn't hold a value. Targets that
    a person places by hand can't be read back: they are asked for, then confirmed.
    asked_target: the one that the person was asked to place and hasn't confirmed yet.
    """

    target_requested = Signal(str)
    wavelength_requested = Signal(float)
    exposure_requested = Signal(float)
    range_told = Signal(str)

    def __init__(self, actions: list[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.target = CommitComboBox(self)
        self.wavelength = CommitSpinBox(
            self, suffix=" nm", decimals=2, minimum=200, maximum=2000, value=550, singleStep=10
        )
        self.exposure = CommitSpinBox(
            self, suffix=" ms", decimals=3, minimum=0.001, maximum=1e6, value=400
        )
        self.exposure.setStepType(CommitSpinBox.StepType.AdaptiveDecimalStepType)
        self.target_read = make_label(self, "–", look="readBack")
        self.wavelength_read = make_label(self, "–", look="readBack")
        self.exposure_read = make_label(self, "–", look="readBack")
        self.asked_target = ""
        self._by_hand = False
        self._confirmed = ""
        self._heading = make_label(self, _READ_BACK, look="faint")
        self._arrange(actions)
        self.target.committed.connect(self.target_requested)
        self.wavelength.committed.connect(lambda nm: self.wavelength_requested.emit(nm * 1e-9))
        self.exposure.committed.connect(lambda ms: self.exposure_requested.emit(ms * 1e-3))
        for field in (self.target, self.wavelength, self.exposure):
            field.pending_changed.connect(self._show_hint)

    def adopt_bench_ranges(self, bench: BenchOpened, target: str) -> None:
        """Give the fields the bench's ranges and targets; choose `target` if it exists.

        Targets that a person places are left open, since nobody has placed one yet.
        """
        for box, (low, high), unit in (
            (self.wavelength, bench.wavelength_range, 1e-9),
            (self.exposure, bench.exposure_range, 1e-3),
        ):
            before = box.set_value
            box.blockSignals(True)
            box.setRange(low / unit, high / unit)
            box.show_value(box.value())
            box.blockSignals(False)
            span = f"{low / unit:g} to {high / unit:g}{box.suffix()}"
            box.setToolTip(f"{span}. {_HINT}")
            if box.set_value != before:
                self.range_told.emit(f"{before:g} isn't within {span}: {box.text()} is set")
        self._by_hand = bench.targets_by_hand
        self.target.clear()
        self.target.addItems(bench.targets)
        self.target.show_text("")
        for name in () if self._by_hand else (*bench.targets[:1], _FIRST_TARGET, target):
            if name in bench.targets:
                self.target.show_text(name)
        self.target.setToolTip(_HINT)
        self.asked_target = ""

    @property
    def set_values(self) -> tuple[float, float]:
        """Return the wavelength in metres and the exposure in seconds that the person has set."""
        return self.wavelength.set_value * 1e-9, self.exposure.set_value * 1e-3

    def request_all_settings(self) -> None:
        """Request every setting from a bench that has just opened."""
        if not self._by_hand:
            self.target_requested.emit(self.target.set_text)
        wavelength, exposure = self.set_values
        self.wavelength_requested.emit(wavelength)
        self.exposure_requested.emit(exposure)

    def set_enabled(self, on: bool, *, run_active: bool, waiting: bool) -> None:
        """Enable the fields, but in a run only the wavelength, for what follows it.

        While a run waits for the person, who looks at live pictures, the exposure is free, too.
        """
        self.wavelength.setEnabled(on)
        self.target.setEnabled(on and not run_active)
        self.exposure.setEnabled(on and (waiting or not run_active))

    def take_back_pending(self) -> None:
        """Take back what the person has proposed in the fields and not set."""
        for field in (self.target, self.wavelength, self.exposure):
            field.take_back()

    def ask_for_target(self, name: str) -> None:
        """Show that a person is asked to place a target; "" ends that."""
        self.asked_target = name
        self._show_target(self._confirmed, doubt=False)

    def show_state(self, state: BenchState) -> None:
        nm, ms = state.wavelength * 1e9, state.exposure * 1e3
        failed = state.failed_devices
        self._confirmed = state.target
        self._show_target(state.target, doubt="targets" in failed)
        for device, field, read, value, text, step in (
            ("filter", self.wavelength, self.wavelength_read, nm, f"{nm:.2f} nm", 5e-3),
            ("camera", self.exposure, self.exposure_read, ms, f"{ms:.3f} ms", 5e-4),
        ):
            # The last value of a failed device may no longer be true.
            doubt = device in failed
            differs = doubt or abs(value - field.set_value) > step
            _read(read, f"{text} ?" if doubt else text, differs)

    def clear_read_back(self) -> None:
        self.asked_target = ""
        for read in (self.target_read, self.wavelength_read, self.exposure_read):
            _read(read, "–", False)

    def _show_target(self, target: str, *, doubt: bool) -> None:
        """Show the target: as read back, or as a person was asked and has confirmed."""
        differs = doubt or target != self.target.set_text
        if self._by_hand:
            text = f"confirmed: {target}" if target else "not confirmed"
            text = f"asked: {self.asked_target}" if self.asked_target else text
            differs = bool(self.asked_target) or not target or differs
        else:
            text = f"{target} ?" if doubt else target
        mark_property(self.target_read, "confirmed", self._by_hand)
        _read(self.target_read, text, differs)

    def _show_hint(self) -> None:
        pending = any(
            one.is_pending and one.isEnabled()
            for one in (self.target, self.wavelength, self.exposure)
        )
        self._heading.setText("Enter sets it" if pending else _READ_BACK)
        mark_difference(self._heading, pending)

    def _arrange(self, actions: list[QAction]) -> None:
        grid = QGridLayout(self)
        grid.setContentsMargins(*PANEL_MARGINS)
        grid.setVerticalSpacing(3)
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(2, 96)
        buttons = [make_tool_button(self, action, look="flat") for action in actions]
        grid.addLayout(fill_layout(QHBoxLayout(), *buttons, 1, spacing=4), 0, 0, 1, 2)
        grid.addWidget(self._heading, 0, 2)
        rows = (
            ("Target", self.target, self.target_read),
            ("Wavelength", self.wavelength, self.wavelength_read),
            ("Exposure", self.exposure, self.exposure_read),
        )
        for number, (name, field, read) in enumerate(rows, start=1):
            grid.addWidget(make_label(self, name), number, 0)
            grid.addWidget(field, number, 1)
            grid.addWidget(read, number, 2)
        grid.setRowStretch(len(rows) + 1, 1)


def _read(value_label: QLabel, text: str, differs: bool) -> None:
    """Show a value read back; sign and colour tell if it isn't the one set."""
    value_label.setText(f"{DIFFERS_SIGN} {text}" if differs else text)
    mark_difference(value_label, differs)
