"""The window's fields for an exposure bracket: shortest exposure, ratio and count."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QDoubleSpinBox, QGridLayout, QSpinBox, QWidget

from labapp.window.exposure_bracket import ExposureBracket
from labapp.window.widgets import make_label


class BracketRow(QObject):
    """Fill two rows of a grid: a bracket's fields, and below them its exposure times."""

    changed = Signal()

    def __init__(self, name: str, first: ExposureBracket, parent: QWidget) -> None:
        super().__init__(parent)
        self._name = make_label(parent, name)
        self.shortest = QDoubleSpinBox(
            parent, suffix=" ms", decimals=3, minimum=0.001, maximum=1e6, value=first.shortest_ms
        )
        self.shortest.setStepType(QDoubleSpinBox.StepType.AdaptiveDecimalStepType)
        self.ratio = QDoubleSpinBox(
            parent, prefix="× ", decimals=1, minimum=1.1, maximum=100, value=first.ratio
        )
        self.count = QSpinBox(parent, minimum=1, maximum=12, value=first.count)
        self.exposures_label = make_label(parent, look="faint", wrap=True)
        for box in (self.shortest, self.ratio, self.count):
            box.valueChanged.connect(lambda _: self._update())
        self._update()

    def add_to_grid(self, grid: QGridLayout, line: int) -> None:
        for column, widget in enumerate((self._name, self.shortest, self.ratio, self.count)):
            grid.addWidget(widget, line, column)
        grid.addWidget(self.exposures_label, line + 1, 0, 1, 4)

    @property
    def bracket(self) -> ExposureBracket:
        return ExposureBracket(self.shortest.value(), self.ratio.value(), self.count.value())

    def _update(self) -> None:
        times = "  ".join(f"{ms:.6g}" for ms in self.bracket.exposures_ms)
        self.exposures_label.setText(f"{times} ms")
        self.changed.emit()
