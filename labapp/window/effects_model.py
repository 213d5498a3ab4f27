"""What the simulator does and why, as rows of a table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QObject, QPersistentModelIndex, Qt
from PySide6.QtGui import QColor

from labapp.window.theme import FAINT, SIMULATED, TEXT

Index = QModelIndex | QPersistentModelIndex

_NOWHERE = QModelIndex()
_COLUMNS = ("Effect", "Level", "Changes at most")


@dataclass(frozen=True)
class EffectRow:
    """One effect of a plan. share: the most that its level changes, relative; None: no limit is
    known. why, physics: a sentence each. how: where the bound comes from."""

    name: str
    level: str
    on: bool
    forced: bool
    share: float | None
    why: str
    physics: str
    how: str

    @staticmethod
    def of(decision: Mapping[str, Any]) -> EffectRow:
        """From a decision as plain data. Raises KeyError where something is missing."""
        return EffectRow(
            decision["effect"],
            decision["level"],
            decision["on"],
            decision["forced"],
            decision["relative"],
            decision["why"],
            decision["physics"],
            decision["bound"]["how"],
        )

    @property
    def told(self) -> str:
        """The share as a person reads it."""
        if self.share is None or math.isinf(self.share):
            return "no limit known"
        return f"{self.share:.1e}" if self.share else "nothing"

    @property
    def tip(self) -> str:
        forced = "Forced by the scene." if self.forced else ""
        sentences = (self.physics, self.why, f"Bound: {self.how}", forced)
        return "\n".join(text[:1].upper() + text[1:] for text in sentences if text)

    @property
    def colour(self) -> QColor:
        if self.forced:
            return QColor(SIMULATED)
        return QColor(TEXT if self.on else FAINT)


class EffectsModel(QAbstractTableModel):
    """The effects of one plan, in the order of the light."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.rows: list[EffectRow] = []

    def show_rows(self, rows: list[EffectRow]) -> None:
        self.beginResetModel()
        self.rows = rows
        self.endResetModel()

    def rowCount(self, parent: Index = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: Index = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(_COLUMNS)

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.DisplayRole:
            return (row.name, row.level, row.told)[index.column()]
        if role == Qt.ItemDataRole.ToolTipRole:
            return row.tip
        if role == Qt.ItemDataRole.ForegroundRole:
            return row.colour
        return None

    def headerData(
        self,
        section: int,
        orientation: Qt.Orientation,
        role: int = Qt.ItemDataRole.DisplayRole,
    ) -> Any:
        if orientation is Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return _COLUMNS[section]
        return None
