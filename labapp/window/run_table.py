"""Table of queued runs: title and record, state and time, and stored frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QModelIndex, QObject, QRect, QSize, Qt
from PySide6.QtGui import QColor, QFont, QPainter
from PySide6.QtWidgets import (
    QAbstractItemView,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from labapp.runs.state import State
from labapp.window.duration_text import format_duration
from labapp.window.messages import RunInfo
from labapp.window.table_base import ALIGN_LEFT, MARGIN, ModelIndex, RowsModel, RowsTable, paint_bar
from labapp.window.theme import FAINT, RUN_SIGNS, RUN_STATES, TEXT
from labapp.window.widgets import make_label, plain_tip

_COLUMNS = ("Run", "State", "Frames")
_WIDTHS = {1: 108, 2: 84}
_EMPTY = "Runs wait here in line: acquire (F6), run a plan (Ctrl+P), resume a run (Ctrl+R)."


class RunModel(RowsModel):
    """Hold the runs of the queue as rows; rows that stay keep their selection."""

    rows: Sequence[RunInfo]

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(dict.fromkeys(_COLUMNS, ""), parent)

    def show_runs(self, runs: tuple[RunInfo, ...]) -> None:
        """Drop rows of removed runs, update the others, and append new ones."""
        numbers = {run.number for run in runs}
        kept = list(self.rows)
        for row in reversed(range(len(kept))):
            if kept[row].number not in numbers:
                self.beginRemoveRows(QModelIndex(), row, row)
                del kept[row]
                self.rows = kept
                self.endRemoveRows()
        if len(runs) > len(kept):
            self.beginInsertRows(QModelIndex(), len(kept), len(runs) - 1)
            self.rows = runs
            self.endInsertRows()
        self.rows = runs
        self.emit_all_changed()

    def data(self, index: ModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        run = self.rows[index.row()]
        if role == Qt.ItemDataRole.ToolTipRole:
            return plain_tip("\n".join(filter(None, (run.title, str(run.path), run.message))))
        if role == Qt.ItemDataRole.DisplayRole:
            return (run.title, run.state.value, f"{run.stored_frames}/{run.planned_frames}")[
                index.column()
            ]
        return None


class _RunPainter(QStyledItemDelegate):
    """Paint a run in two lines: title and file, state and time, and a bar of its frames."""

    def __init__(self, model: RunModel, parent: QObject) -> None:
        super().__init__(parent)
        self._model = model

    def sizeHint(self, option: QStyleOptionViewItem, index: ModelIndex) -> QSize:
        return QSize(0, 2 * option.fontMetrics.lineSpacing() + 6)

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: ModelIndex) -> None:
        run = self._model.rows[index.row()]
        whole: QRect = option.rect
        if option.state & QStyle.StateFlag.State_Selected:
            painter.fillRect(whole, QColor("#3a2f1c"))
        place = whole.adjusted(MARGIN, 2, -MARGIN, -2)
        painter.save()
        colour = RUN_STATES[run.state]
        if index.column() == 0:
            _two_lines(painter, place, (run.title, TEXT), (run.path.name, FAINT))
        elif index.column() == 1:
            state = f"{RUN_SIGNS[run.state]} {run.state.value}"
            _two_lines(painter, place, (state, colour), (_time(run), FAINT), bold=True)
        else:
            _bar(painter, place, run, QColor(colour))
        painter.restore()


class RunTable(RowsTable):
    """Show the queue's runs in the order in which they are taken."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.runs = RunModel(self)
        self.set_up(self.runs, _RunPainter(self.runs, self), 0, _WIDTHS)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.verticalHeader().setDefaultSectionSize(2 * self.fontMetrics().lineSpacing() + 6)
        self._empty = make_label(self, _EMPTY, look="faint", wrap=True)
        self._empty.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)

    def show_runs(self, runs: tuple[RunInfo, ...]) -> None:
        grown = len(runs) > len(self.runs.rows)
        self.runs.show_runs(runs)
        self._empty.setVisible(not runs)
        if grown:
            self.scrollToBottom()

    @property
    def selected_runs(self) -> list[RunInfo]:
        rows = self.selectionModel().selectedRows()
        return [self.runs.rows[index.row()] for index in rows]

    def resizeEvent(self, event: Any) -> None:
        super().resizeEvent(event)
        self._empty.setGeometry(self.viewport().geometry().adjusted(8, 2, -8, -2))


def _time(run: RunInfo) -> str:
    """Return the time of a run as text."""
    if run.state is State.WAITING:
        return "" if run.seconds_left is None else f"takes {format_duration(run.seconds_left)}"
    if run.state is State.PAUSED:
        return "waits for you"
    if run.state is State.RUNNING:
        return "" if run.seconds_left is None else f"{format_duration(run.seconds_left)} left"
    return f"took {format_duration(run.elapsed_seconds)}" if run.elapsed_seconds else ""


def _two_lines(
    painter: QPainter,
    place: QRect,
    first: tuple[str, str],
    second: tuple[str, str],
    *,
    bold: bool = False,
) -> None:
    """Paint two lines, each a text with its colour.

    A second line that is too long loses its middle, where names of records differ least.
    """
    font = QFont(painter.font())
    for (text, colour), thick, top in ((first, bold, True), (second, False, False)):
        font.setBold(thick)
        painter.setFont(font)
        painter.setPen(QColor(colour))
        mode = Qt.TextElideMode.ElideRight if top else Qt.TextElideMode.ElideMiddle
        shown = painter.fontMetrics().elidedText(text, mode, place.width())
        half = QRect(place.left(), place.top(), place.width(), place.height() // 2)
        if not top:
            half.moveBottom(place.bottom())
        painter.drawText(half, ALIGN_LEFT, shown)


def _bar(painter: QPainter, place: QRect, run: RunInfo, colour: QColor) -> None:
    """Paint a bar of stored frames as a share of the planned ones."""
    bar = QRect(place.left(), place.top(), place.width(), painter.fontMetrics().height() + 3)
    bar.moveCenter(place.center())
    share = run.stored_frames / run.planned_frames if run.planned_frames else 0.0
    paint_bar(painter, bar, share, colour.darker(220))
    painter.drawText(bar, Qt.AlignmentFlag.AlignCenter, f"{run.stored_frames}/{run.planned_frames}")
