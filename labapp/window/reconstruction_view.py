"""The window's view of a reconstruction: method, time, both pictures, and figures of quality."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from labapp.window.before_after_view import BeforeAfterView
from labapp.window.messages import ReconstructionResult
from labapp.window.widgets import fill_layout, make_label, make_tool_button
from optics.deconvolution.method_names import AUTO, RESTORATIONS

METHODS = {
    "Automatic": AUTO,
    **{one.title[0].upper() + one.title[1:]: name for name, one in RESTORATIONS.items()},
}
"""Names of the restoration methods in the engine, by their titles in the window."""

_EMPTY = (
    "Nothing is reconstructed yet: acquire a bracket (F6) or open a run, then reconstruct it (F7)."
)


class ReconstructionView(QWidget):
    """Let the person choose a restoration method and its time, and show the engine's result.

    `save_requested` is emitted when the person wants to save the restored picture.
    """

    save_requested = Signal()

    def __init__(self, reconstruct: QAction, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.method = QComboBox(self)
        self.method.addItems(list(METHODS))
        self.method.setToolTip("Method: automatic takes what serves best in the time")
        self.budget = QDoubleSpinBox(self, decimals=2, maximum=3600.0, singleStep=0.1)
        self.budget.setSuffix(" s")
        self.budget.setSpecialValueText("as usual")
        self.budget.setToolTip("Processor seconds that it may take")
        self.grey = QCheckBox("Grey", self)
        self.grey.setToolTip(
            "Of a sensor with colour filters, restore one grey band: for light of one colour"
        )
        self.start = make_tool_button(self, reconstruct)
        self.before = QPushButton("Before", self)
        self.before.setToolTip("While you hold it, the photograph before is all that is seen")
        self.save = QPushButton("Save …", self)
        self.picture = BeforeAfterView(self)
        self.note = make_label(self, _EMPTY, look="faint", wrap=True)
        self.before.pressed.connect(lambda: self.picture.show_only_before(True))
        self.before.released.connect(lambda: self.picture.show_only_before(False))
        self.save.clicked.connect(self.save_requested)
        for button in (self.before, self.save):
            button.setEnabled(False)
        self._arrange()

    @property
    def choices(self) -> tuple[str, float | None, bool]:
        """Return method, processor seconds and whether grey is chosen in the window.

        The seconds are None for the usual time.
        """
        method = METHODS[self.method.currentText()]
        return method, self.budget.value() or None, self.grey.isChecked()

    def show_result(self, result: ReconstructionResult) -> None:
        self.picture.show_before_after(result.before, result.after)
        self.note.setText(describe_result(result))
        self.note.setToolTip(str(result.path))
        for button in (self.before, self.save):
            button.setEnabled(True)

    def _arrange(self) -> None:
        choices = self.method, make_label(self, "Time"), self.budget, self.grey, self.start
        bar = fill_layout(QHBoxLayout(), *choices, 1, self.before, self.save, spacing=6)
        parts = bar, (self.picture, 1), self.note
        fill_layout(QVBoxLayout(self), *parts, margins=(0, 4, 0, 0), spacing=4)
        self.note.setTextFormat(Qt.TextFormat.PlainText)


def describe_result(result: ReconstructionResult) -> str:
    """Describe a reconstruction in a few sentences for the person at the window."""
    weight = "" if result.weight is None else f", weight {result.weight:.3g}"
    scores = ""
    if result.scores is not None:
        (before, was), (after, now) = result.scores
        scores = (
            f"Against the neutral photograph PSNR {before:.1f} to {after:.1f} dB, "
            f"SSIM {was:.3f} to {now:.3f}. "
        )
    return (
        f"{result.source}: {result.method}{weight}, {result.iterations} iterations in "
        f"{result.cpu_seconds:.2f} s of processor time. {scores}Noise {result.noise:.3g} "
        f"{result.unit}, {result.noise_source}. Residual {result.residual:.2f} of the noise, "
        f"{result.verdict}. Drag the divider; zoom with the wheel, double-click to fit."
    )
