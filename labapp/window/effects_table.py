"""Table of simulated effects: level and error in a line, the reason below it."""

from __future__ import annotations

import math

from PySide6.QtCore import QRect, Qt
from PySide6.QtGui import QColor, QPainter, QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from labapp.window.effects_model import EffectsModel, effect_colour, error_text, reason_text
from labapp.window.messages import EffectInfo
from labapp.window.table_base import ALIGN_LEFT, MARGIN, ModelIndex, RowsTable, paint_bar
from labapp.window.theme import FAINT, PANEL

BAR_COLUMN = 2
"""Index of the column in which the errors are drawn as bars."""

_BAR_MINIMUM = 1e-7
"""Relative change of the picture at the left end of a bar; the right end is a change of 1."""

_WIDEST = ("neighbour coupling", "skewed Gaussian")
"""The longest texts of the first two columns, from which the columns' widths follow."""

_WRAPPED = Qt.TextFlag.TextWordWrap | Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft


class EffectsTable(RowsTable):
    """Show the simulated effects in the order in which they act on the light.

    tol: tolerance, the picture's relative error that all levels together may cause.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.effects = EffectsModel(self)
        self.tol = 0.0
        widths = [self.fontMetrics().horizontalAdvance(words) + 2 * MARGIN for words in _WIDEST]
        self.set_up(self.effects, _EffectPainter(self), BAR_COLUMN, dict(enumerate(widths)))
        self.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)

    def show_effects(self, effects: tuple[EffectInfo, ...], tol: float) -> None:
        self.tol = tol
        self.effects.show_rows(effects)
        self._fit_rows()

    @property
    def line_height(self) -> int:
        """Return how far below a row's top its sentence begins, pixels."""
        return self.fontMetrics().lineSpacing() + 6

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit_rows()

    def _fit_rows(self) -> None:
        """Fit the row heights to the text, which wraps at the table's width."""
        room = QRect(0, 0, self.viewport().width() - 2 * MARGIN, 1000)
        for number, row in enumerate(self.effects.rows):
            needed = self.fontMetrics().boundingRect(room, _WRAPPED, reason_text(row))
            self.setRowHeight(number, self.line_height + needed.height() + MARGIN + 5)


class _EffectPainter(QStyledItemDelegate):
    """Paint an effect's row: a line of cells, and a sentence below all columns."""

    def __init__(self, table: EffectsTable) -> None:
        super().__init__(table)
        self._table = table

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: ModelIndex) -> None:
        row = self._table.effects.rows[index.row()]
        cell: QRect = option.rect
        top = QRect(cell.left(), cell.top() + 3, cell.width(), self._table.line_height)
        painter.save()
        # Qt paints cell by cell, so each cell paints its own part of the sentence.
        painter.setClipRect(cell, Qt.ClipOperation.IntersectClip)
        if index.column() == BAR_COLUMN:
            _bar(painter, top.adjusted(0, 1, -MARGIN, -3), row, self._table.tol)
        else:
            text, place = index.data(), top.adjusted(MARGIN, 1, 0, -3)
            painter.setPen(QColor(effect_colour(row)))
            painter.drawText(place, ALIGN_LEFT, _elide_text(painter, text, place.width() - MARGIN))
        whole = QRect(0, cell.top(), self._table.viewport().width(), cell.height())
        painter.setPen(QColor(FAINT))
        below = whole.adjusted(MARGIN, 3 + self._table.line_height, -MARGIN, 0)
        painter.drawText(below, _WRAPPED, reason_text(row))
        painter.setPen(QColor(PANEL))
        painter.drawLine(whole.bottomLeft(), whole.bottomRight())
        painter.restore()


def _bar(painter: QPainter, place: QRect, row: EffectInfo, tol: float) -> None:
    """Paint an effect's error as a logarithmic bar, with number and a line at the tolerance."""
    paint_bar(painter, place, _bar_position(row.error), QColor(effect_colour(row)).darker(250))
    mark = place.left() + round((place.width() - 1) * _bar_position(tol))
    painter.drawLine(mark, place.top(), mark, place.bottom())
    painter.setPen(QColor(effect_colour(row)))
    painter.drawText(place.adjusted(MARGIN, 0, 0, 0), ALIGN_LEFT, error_text(row))


def _elide_text(painter: QPainter, text: str, width: int) -> str:
    return painter.fontMetrics().elidedText(text, Qt.TextElideMode.ElideRight, width)


def _bar_position(share: float | None) -> float:
    """Return where an error lies on its bar, 0 to 1; an unknown one is at 1."""
    if share is None:
        return 1.0
    if share <= _BAR_MINIMUM:
        return 0.0
    return min(1 - math.log(share) / math.log(_BAR_MINIMUM), 1.0)
