"""The panel "Why": what the simulator does for the picture on the screen, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QObject, QRect, Qt
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTableView,
    QVBoxLayout,
    QWidget,
)

from labapp.window.effects_model import EffectRow, EffectsModel, Index
from labapp.window.label import label
from labapp.window.panel import Panel
from labapp.window.theme import EDGE, ERROR, FIELD

BAR = 2
"""The column of bars."""

_LEAST = 1e-7
"""Relative change at the left end of a bar; the right end is the whole picture."""

_EMPTY = "What the simulator does appears here with the first picture."


class EffectsPanel(Panel):
    """Each effect with its level, and what that changes at most against the tolerance."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.summary = label(self, _EMPTY, look="faint", wrap=True)
        self.model = EffectsModel(self)
        self.table = QTableView(self)
        self.table.setModel(self.model)
        self._bars = _Bars(self.model, self.table)
        self.table.setItemDelegateForColumn(BAR, self._bars)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.table.setShowGrid(False)
        self.table.setTabKeyNavigation(False)
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(self.fontMetrics().lineSpacing() + 6)
        header = self.table.horizontalHeader()
        header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        for column in range(BAR):
            header.setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(BAR, QHeaderView.ResizeMode.Stretch)
        layout = QVBoxLayout(self)
        layout.addWidget(self.summary)
        layout.addWidget(self.table)

    def show_plan(self, plan: Mapping[str, Any] | None) -> None:
        """A plan as plain data, as EffectPlan.as_data() gives it; None where nothing is
        simulated. Raises KeyError for data of something else."""
        if plan is None:
            self.model.show_rows([])
            self.summary.setText(_EMPTY)
            return
        rows = [EffectRow.of(decision) for decision in plan["decisions"]]
        self._bars.tol = plan["tol"]
        self.summary.setText(_summary(plan, sum(row.on for row in rows)))
        self.model.show_rows(rows)


def _summary(plan: Mapping[str, Any], on: int) -> str:
    error, tol = plan["error"], plan["tol"]
    count = f"{on} of {len(plan['decisions'])} effects are on"
    if error is None:
        return f"{count}; how far the picture is from that with all of them isn't known."
    kept = "" if error <= tol else ", which forced effects exceed"
    work = plan["work"] / plan["most_work"] if plan["most_work"] else 1.0
    return (
        f"{count}. The picture is within {error:.1e} of that with all of them (tolerance "
        f"{tol:.1e}{kept}), for {work:.1%} of the work."
    )


class _Bars(QStyledItemDelegate):
    """A bar on a logarithmic scale, a mark at the tolerance, and the number."""

    def __init__(self, model: EffectsModel, parent: QObject) -> None:
        super().__init__(parent)
        self._model = model
        self.tol = 0.01

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
        row = self._model.rows[index.row()]
        place: QRect = option.rect.adjusted(2, 2, -2, -2)
        painter.save()
        painter.fillRect(place, QColor(FIELD))
        full = QRect(place)
        full.setWidth(round(place.width() * _along(row.share)))
        painter.fillRect(full, row.colour.darker(250))
        mark = place.left() + round((place.width() - 1) * _along(self.tol))
        painter.setPen(QColor(ERROR))
        painter.drawLine(mark, place.top(), mark, place.bottom())
        painter.setPen(QColor(EDGE))
        painter.drawRect(place.adjusted(0, 0, -1, -1))
        painter.setPen(row.colour)
        painter.drawText(
            place.adjusted(5, 0, -3, 0),
            Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft,
            row.told,
        )
        painter.restore()


def _along(share: float | None) -> float:
    """Where a share lies on a bar, 0 to 1; one that isn't known at its end."""
    if share is None:
        return 1.0
    if share <= _LEAST:
        return 0.0
    return min(1 - math.log(share) / math.log(_LEAST), 1.0)
