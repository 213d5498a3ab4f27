"""The table in the tab "Accuracy": what each tolerance costs, one row for each decade."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QAbstractItemView, QStyledItemDelegate, QWidget

from labapp.window.duration_text import format_processor_time
from labapp.window.effects_model import format_share
from labapp.window.messages import AccuracyForecast, AccuracyPoint
from labapp.window.table_base import MARGIN, ModelIndex, RowsModel, RowsTable
from labapp.window.widgets import plain_tip

_COLUMNS = {
    "Tolerance": "The relative error that you accept",
    "PSF error": "Relative error of a predicted PSF, as its method states beforehand",
    "First PSF": "Predicted processor time of the first PSF, planning included",
    "Each PSF": "Predicted processor time of every further PSF",
    "Memory": "Largest arrays of a PSF",
    "Live error": "Largest relative error of a live picture of the virtual bench",
    "Live time": "About the processor time of a new live picture of the virtual bench",
    "Method": "What is chosen automatically at this tolerance",
}


@dataclass(frozen=True)
class ToleranceRow:
    """Texts about one tolerance, and why it can't be kept if so."""

    cells: tuple[str, ...]
    failure: str = ""


class AccuracyModel(RowsModel):
    """Hold one row for each tolerance."""

    rows: Sequence[ToleranceRow]

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(_COLUMNS, parent)

    def show_rows(self, rows: Sequence[ToleranceRow]) -> None:
        self.beginResetModel()
        self.rows = rows
        self.endResetModel()

    def data(self, index: ModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.DisplayRole:
            return row.cells[index.column()]
        return plain_tip(row.failure) or None if role == Qt.ItemDataRole.ToolTipRole else None


class AccuracyTable(RowsTable):
    """Show what each tolerance costs; the selected row is the present setting."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.tolerances = AccuracyModel(self)
        letters = self.fontMetrics()
        widths = {
            column: letters.horizontalAdvance(heading) + 4 * MARGIN
            for column, heading in enumerate(list(_COLUMNS)[:-1])
        }
        self.set_up(self.tolerances, QStyledItemDelegate(self), len(_COLUMNS) - 1, widths)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.verticalHeader().setDefaultSectionSize(letters.lineSpacing() + 5)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)

    def show_forecast(self, forecast: AccuracyForecast) -> None:
        """Show what each tolerance is predicted to cost."""
        live = {one.tol: one for one in forecast.live}
        rows = []
        for tol in forecast.tolerances:
            point, picture = forecast.chosen_point(tol), live.get(tol)
            rows.append(
                ToleranceRow(
                    (
                        format_decade(tol),
                        *_prediction_texts(point),
                        "–" if picture is None else _share(picture.error),
                        format_processor_time(None if picture is None else picture.seconds),
                        "can't be kept" if point is None else point.method,
                    ),
                    forecast.failure(tol) if point is None else "",
                )
            )
        self.tolerances.show_rows(rows)
        height = self.horizontalHeader().height() + len(rows) * self.rowHeight(0)
        self.setFixedHeight(height + 2 * self.frameWidth())


def format_decade(tol: float) -> str:
    """Format a tolerance of a whole decade: 1e-1, 1e-2."""
    return f"1e{round(math.log10(tol))}"


def _prediction_texts(point: AccuracyPoint | None) -> tuple[str, str, str, str]:
    """Return a predicted PSF's error, both times, and memory as texts."""
    if point is None:
        return "–", "–", "–", "–"
    return (
        _share(point.error),
        format_processor_time(point.first_seconds),
        format_processor_time(point.each_seconds),
        "–" if point.memory is None else f"{point.memory / 1e6:.3g} MB",
    )


def _share(error: float | None) -> str:
    return "–" if error is None else format_share(float(f"{error:.1e}"))
