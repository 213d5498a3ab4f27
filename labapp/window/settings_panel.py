"""The window's panel of target, wavelength and exposure, each as set and as read back."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QDoubleSpinBox, QGridLayout, QLabel, QWidget

from labapp.window.messages import BenchOpened, BenchState
from labapp.window.theme import DIFFERS_SIGN
from labapp.window.widgets import PANEL_MARGINS, make_label, mark_difference

_FIRST_TARGET = "photograph"


class SettingsPanel(QWidget):
    """Let the person set target, wavelength and exposure; its signals are in metres and seconds."""

    target_requested = Signal(str)
    wavelength_requested = Signal(float)
    exposure_requested = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.target = QComboBox(self)
        self.wavelength = QDoubleSpinBox(
            self, suffix=" nm", decimals=2, minimum=200, maximum=2000, value=550, singleStep=10
        )
        self.exposure = QDoubleSpinBox(
            self, suffix=" ms", decimals=3, minimum=0.001, maximum=1e6, value=400
        )
        for box in (self.wavelength, self.exposure):
            # A number is sent only when it is typed completely.
            box.setKeyboardTracking(False)
        self.exposure.setStepType(QDoubleSpinBox.StepType.AdaptiveDecimalStepType)
        self.target_read = make_label(self, "–", look="readBack")
        self.wavelength_read = make_label(self, "–", look="readBack")
        self.exposure_read = make_label(self, "–", look="readBack")
        grid = QGridLayout(self)
        grid.setContentsMargins(*PANEL_MARGINS)
        grid.setVerticalSpacing(4)
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(2, 96)
        grid.addWidget(make_label(self, "set", look="faint"), 0, 1)
        grid.addWidget(make_label(self, "read back", look="faint"), 0, 2)
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
        self.target.activated.connect(
            lambda _: self.target_requested.emit(self.target.currentText())
        )
        self.wavelength.valueChanged.connect(lambda nm: self.wavelength_requested.emit(nm * 1e-9))
        self.exposure.valueChanged.connect(lambda ms: self.exposure_requested.emit(ms * 1e-3))

    def adopt_bench_ranges(self, bench: BenchOpened, target: str) -> None:
        """Give the window's fields the bench's ranges and targets; choose `target` if it exists."""
        for box, (low, high), unit in (
            (self.wavelength, bench.wavelength_range, 1e-9),
            (self.exposure, bench.exposure_range, 1e-3),
        ):
            box.blockSignals(True)
            box.setRange(low / unit, high / unit)
            box.blockSignals(False)
            box.setToolTip(f"{low / unit:g} to {high / unit:g}{box.suffix()}")
        self.target.clear()
        self.target.addItems(bench.targets)
        for name in (_FIRST_TARGET, target):
            if name in bench.targets:
                self.target.setCurrentText(name)

    def request_all_settings(self) -> None:
        """Request every setting in the window from a bench that has just opened."""
        self.target_requested.emit(self.target.currentText())
        self.wavelength_requested.emit(self.wavelength.value() * 1e-9)
        self.exposure_requested.emit(self.exposure.value() * 1e-3)

    def set_run_active(self, on: bool) -> None:
        """Disable the window's target and exposure during a run, but not the wavelength.

        The wavelength can be set for the next run.
        """
        self.target.setEnabled(not on)
        self.exposure.setEnabled(not on)

    def show_state(self, state: BenchState) -> None:
        nm, ms = state.wavelength * 1e9, state.exposure * 1e3
        off = {
            "targets": state.target != self.target.currentText(),
            "filter": abs(nm - self.wavelength.value()) > 5e-3,
            "camera": abs(ms - self.exposure.value()) > 5e-4,
        }
        for device, read, text in (
            ("targets", self.target_read, state.target),
            ("filter", self.wavelength_read, f"{nm:.2f} nm"),
            ("camera", self.exposure_read, f"{ms:.3f} ms"),
        ):
            # The last value of a failed device may no longer be true.
            doubt = device in state.failed_devices
            _read(read, f"{text} ?" if doubt else text, off[device] or doubt)

    def clear_read_back(self) -> None:
        for read in (self.target_read, self.wavelength_read, self.exposure_read):
            _read(read, "–", False)


def _read(value_label: QLabel, text: str, differs: bool) -> None:
    """Show a value read back in the window; sign and colour tell if it isn't the one set."""
    value_label.setText(f"{DIFFERS_SIGN} {text}" if differs else text)
    mark_difference(value_label, differs)
