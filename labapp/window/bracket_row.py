"""Fields for an exposure bracket: a ladder's, or the signal-to-noise ratio's."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QWidget

from labapp.window.exposure_bracket import (
    ExposureBracket,
    ProposedBracket,
    RequestedBracket,
    SNRBracket,
    list_exposures,
)
from labapp.window.number_fields import NumberBox, WholeNumberBox
from labapp.window.widgets import make_label

_LEAST_WIDTH = 86
"""Least width of a field in pixels: "1000.000 ms" fits. Chosen."""


class BracketRow(QObject):
    """Fill two rows of a grid: a bracket's fields, and below them its exposure times."""

    changed = Signal()

    def __init__(
        self, name: str, first: ExposureBracket, wanted: SNRBracket, parent: QWidget
    ) -> None:
        super().__init__(parent)
        self._name = make_label(parent, name)
        self.shortest = NumberBox(
            parent, suffix=" ms", decimals=3, minimum=0.001, maximum=1e6, value=first.shortest_ms
        )
        self.shortest.setStepType(NumberBox.StepType.AdaptiveDecimalStepType)
        self.ratio = NumberBox(
            parent, prefix="× ", decimals=1, minimum=1.1, maximum=100, value=first.ratio
        )
        self.count = WholeNumberBox(parent, minimum=1, maximum=12, value=first.count)
        self.snr = NumberBox(
            parent, suffix=" dB", decimals=1, minimum=5, maximum=60, value=wanted.snr_db
        )
        self.snr.setToolTip("Signal-to-noise ratio of each merged pixel, 20 log10")
        self.decades = NumberBox(
            parent, suffix=" decades", decimals=1, minimum=0.5, maximum=8, value=wanted.decades
        )
        self.decades.setToolTip("Depth of the range below the brightest pixels")
        self.chosen = QCheckBox("chosen", parent)
        self.chosen.setToolTip("The run meters the light, and chooses exposures for a ratio in dB")
        for one in (self.shortest, self.ratio, self.snr, self.decades):
            # Values of everyday use fit; Qt would leave room for the largest ones.
            one.setMinimumWidth(_LEAST_WIDTH)
        self.exposures_label = make_label(parent, look="faint", wrap=True)
        # No higher than the label beside it, or the window outgrows a small screen.
        self.chosen.setMaximumHeight(self.exposures_label.fontMetrics().height())
        self._proposed: ProposedBracket | None = None
        for box in (self.shortest, self.ratio, self.count, self.snr, self.decades):
            box.valueChanged.connect(lambda _: self._end_proposal())
        self.chosen.toggled.connect(lambda _: self._end_proposal())
        self._update()

    def add_to_grid(self, grid: QGridLayout, line: int) -> None:
        for column, widget in enumerate((self._name, self.shortest, self.ratio, self.count)):
            grid.addWidget(widget, line, column)
        for column, widget in enumerate((self.snr, self.decades), 1):
            grid.addWidget(widget, line, column)
        grid.addWidget(self.chosen, line + 1, 0)
        grid.addWidget(self.exposures_label, line + 1, 1, 1, 3)

    @property
    def bracket(self) -> RequestedBracket:
        if self._proposed is not None:
            return self._proposed
        if self.chosen.isChecked():
            return SNRBracket(self.snr.value(), self.decades.value())
        return ExposureBracket(self.shortest.value(), self.ratio.value(), self.count.value())

    def propose(self, bracket: ProposedBracket) -> None:
        """Request a proposed bracket until a field of this row is changed."""
        self.chosen.setChecked(False)
        self._proposed = bracket
        self._update()

    def _end_proposal(self) -> None:
        self._proposed = None
        self._update()

    def _update(self) -> None:
        for box in (self.shortest, self.ratio, self.count):
            box.setVisible(not self.chosen.isChecked())
        for box in (self.snr, self.decades):
            box.setVisible(self.chosen.isChecked())
        said = list_exposures(self.bracket.exposures_ms) or "chosen by metering, in the run"
        if self._proposed is not None:
            said = f"{said}, {self._proposed.why}"
        self.exposures_label.setText(said)
        self.changed.emit()
