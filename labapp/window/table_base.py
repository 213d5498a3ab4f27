"""Base classes of the tables of runs and of effects, which paint their own rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import (
    QAbstractTableModel,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QRect,
    QSize,
    Qt,
)
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QAbstractItemDelegate, QHeaderView, QTableView, QWidget

from labapp.window.theme import EDGE, PANEL, TEXT

ModelIndex = QModelIndex | QPersistentModelIndex

MARGIN = 5
"""Margin in pixels beside the text in a cell of a table."""

ALIGN_LEFT = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft

_NOWHERE = QModelIndex()


class RowsModel(QAbstractTableModel):
    """Hold the rows of a table, and its headings with their tool tips."""

    def __init__(self, headings: dict[str, str], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._headings, self._tips = list(headings), list(headings.values())
        self.rows: Sequence[Any] = ()

    def emit_all_changed(self) -> None:
        if self.rows:
            last = self.index(len(self.rows) - 1, len(self._headings) - 1)
            self.dataChanged.emit(self.index(0, 0), last)

    def rowCount(self, parent: ModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: ModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self._headings)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        if orientation is not Qt.Orientation.Horizontal:
            return None
        if role == Qt.ItemDataRole.ToolTipRole:
            return self._tips[section] or None
        return self._headings[section] if role == Qt.ItemDataRole.DisplayRole else None


class RowsTable(QTableView):
    """Show the rows of a RowsModel."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.verticalHeader().hide()
        self.horizontalHeader().setHighlightSections(False)
        self.horizontalHeader().setDefaultAlignment(ALIGN_LEFT)

    def set_up(
        self, model: RowsModel, painter: QAbstractItemDelegate, wide: int, widths: dict[int, int]
    ) -> None:
        """Attach model and painter, and set the widths of the columns.

        wide: column that takes the room that is left.
        widths: those of the others, pixels.
        """
        self.setModel(model)
        self.setItemDelegate(painter)
        header = self.horizontalHeader()
        header.setSectionResizeMode(wide, QHeaderView.ResizeMode.Stretch)
        for column, width in widths.items():
            header.setSectionResizeMode(column, QHeaderView.ResizeMode.Fixed)
            self.setColumnWidth(column, width)

    def sizeHint(self) -> QSize:
        return QSize(300, 160)

    def minimumSizeHint(self) -> QSize:
        return QSize(260, 86)


def paint_bar(painter: QPainter, place: QRect, share: float, colour: QColor) -> None:
    """Paint a frame filled from the left to a share of its width; the pen is left as for text."""
    painter.fillRect(place, QColor(PANEL))
    painter.fillRect(place.adjusted(0, 0, round(place.width() * share) - place.width(), 0), colour)
    painter.setPen(QColor(EDGE))
    painter.drawRect(place.adjusted(0, 0, -1, -1))
    painter.setPen(QColor(TEXT))
