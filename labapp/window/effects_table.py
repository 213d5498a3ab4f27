"""The table of effects: level and limit in a line, and why in the next."""

from __future__ import annotations

import math

from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTableView,
    QWidget,
)

from labapp.window.effects_model import EffectsModel, Index, colour, limit, reason
from labapp.window.messages import EffectTold
from labapp.window.theme import EDGE, FAINT, PANEL, TEXT

BAR = 2
"""The column of bars."""

_LEAST = 1e-7
"""Relative change at the left end of a bar; the right end is the whole picture."""

_WIDEST = ("neighbour coupling", "skewed Gaussian")
"""The longest words that the first columns have to hold."""

_MARGIN = 5
_LEFT = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft
_WRAPPED = Qt.TextFlag.TextWordWrap | Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft


class EffectsTable(QTableView):
    """Effects in the order of the light. tol: what all of them may change together."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.effects = EffectsModel(self)
        self.tol = 0.0
        self.setModel(self.effects)
        self.setItemDelegate(_Painter(self))
        self.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.verticalHeader().hide()
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setDefaultAlignment(_LEFT)
        header.setSectionResizeMode(BAR, QHeaderView.ResizeMode.Stretch)
        for column, words in enumerate(_WIDEST):
            header.setSectionResizeMode(column, QHeaderView.ResizeMode.Fixed)
            width = self.fontMetrics().horizontalAdvance(words)
            self.setColumnWidth(column, width + 2 * _MARGIN)

    def show_effects(self, effects: tuple[EffectTold, ...], tol: float) -> None:
        self.tol = tol
        self.effects.show_rows(effects)
        self._fit_rows()

    @property
    def line(self) -> int:
        """Pixels from the top of a row's cells to its sentence."""
        return self.fontMetrics().lineSpacing() + 6

    def sizeHint(self) -> QSize:
        return QSize(300, 160)

    def minimumSizeHint(self) -> QSize:
        return QSize(260, 86)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit_rows()

    def _fit_rows(self) -> None:
        """Sentences wrap, so how high a row is follows from how wide the table is."""
        room = QRect(0, 0, self.viewport().width() - 2 * _MARGIN, 1000)
        for number, row in enumerate(self.effects.rows):
            needed = self.fontMetrics().boundingRect(room, _WRAPPED, reason(row))
            self.setRowHeight(number, self.line + needed.height() + _MARGIN + 5)


class _Painter(QStyledItemDelegate):
    """A line of cells, and below it a sentence as wide as the row."""

    def __init__(self, table: EffectsTable) -> None:
        super().__init__(table)
        self._table = table

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
        row = self._table.effects.rows[index.row()]
        cell: QRect = option.rect
        top = QRect(cell.left(), cell.top() + 3, cell.width(), self._table.line)
        painter.save()
        # Each cell paints its own part of the sentence, for cells are painted one by one.
        painter.setClipRect(cell, Qt.ClipOperation.IntersectClip)
        if index.column() == BAR:
            _bar(painter, top.adjusted(0, 1, -_MARGIN, -3), row, self._table.tol)
        else:
            text, place = index.data(), top.adjusted(_MARGIN, 1, 0, -3)
            painter.setPen(QColor(colour(row)))
            painter.drawText(place, _LEFT, _elided(painter, text, place.width() - _MARGIN))
        whole = QRect(0, cell.top(), self._table.viewport().width(), cell.height())
        painter.setPen(QColor(FAINT))
        below = whole.adjusted(_MARGIN, 3 + self._table.line, -_MARGIN, 0)
        painter.drawText(below, _WRAPPED, reason(row))
        painter.setPen(QColor(PANEL))
        painter.drawLine(whole.bottomLeft(), whole.bottomRight())
        painter.restore()


def _bar(painter: QPainter, place: QRect, row: EffectTold, tol: float) -> None:
    """A bar on a logarithmic scale, a mark at the tolerance, and the number."""
    painter.fillRect(place, QColor(PANEL))
    full = QRect(place)
    full.setWidth(round(place.width() * _along(row.at_most)))
    painter.fillRect(full, QColor(colour(row)).darker(250))
    painter.setPen(QColor(EDGE))
    painter.drawRect(place.adjusted(0, 0, -1, -1))
    painter.setPen(QColor(TEXT))
    mark = place.left() + round((place.width() - 1) * _along(tol))
    painter.drawLine(mark, place.top(), mark, place.bottom())
    painter.setPen(QColor(colour(row)))
    painter.drawText(place.adjusted(_MARGIN, 0, 0, 0), _LEFT, limit(row))


def _elided(painter: QPainter, text: str, width: int) -> str:
    return painter.fontMetrics().elidedText(text, Qt.TextElideMode.ElideRight, width)


def _along(share: float | None) -> float:
    """Where a share lies on a bar, 0 to 1; one that isn't known at its end."""
    if share is None:
        return 1.0
    if share <= _LEAST:
        return 0.0
    return min(1 - math.log(share) / math.log(_LEAST), 1.0)
