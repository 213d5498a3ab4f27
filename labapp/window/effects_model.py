"""Levels, errors and reasons of simulated effects, as data of their table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QObject, Qt

from labapp.window.messages import EffectInfo
from labapp.window.table_base import ModelIndex, RowsModel
from labapp.window.theme import FAINT, SIMULATED, TEXT
from labapp.window.widgets import plain_tip

_COLUMNS = {
    "Effect": "Whatever optics and electronics of this bench could do to the picture, in the "
    "light's order",
    "Level": "How far the simulator goes: faint is off, amber is forced by the scene",
    "Error left": "What is beyond that level, relative to the picture: at most, or likely where "
    "estimates decide. The bar is logarithmic, from 1e-7 to 1; the line is the tolerance, which "
    "all effects share",
}


class EffectsModel(RowsModel):
    """Hold the simulated effects of one picture, in the order in which they act on the light."""

    rows: Sequence[EffectInfo]

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(_COLUMNS, parent)

    def show_rows(self, rows: tuple[EffectInfo, ...]) -> None:
        """Show new rows; if the effects are the same as before, the scroll position stays."""
        if [row.name for row in rows] != [row.name for row in self.rows]:
            self.beginResetModel()
            self.rows = rows
            self.endResetModel()
        else:
            self.rows = rows
            self.emit_all_changed()

    def data(self, index: ModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.DisplayRole:
            return (row.name, row.level, error_text(row))[index.column()]
        return plain_tip(_tip(row)) if role == Qt.ItemDataRole.ToolTipRole else None


def format_share(number: float) -> str:
    """Format a relative change of a picture: 0.18, 4e-3, 1.2e-5, 0."""
    if number == 0 or number >= 0.1:
        return f"{number:.2g}"
    digits, power = f"{number:.1e}".split("e")
    return f"{digits.removesuffix('.0')}e{int(power)}"


def error_text(row: EffectInfo) -> str:
    """Return an effect's error as text."""
    if row.error is None:
        return "no limit known"
    return format_share(row.error) if row.error else "nothing"


def reason_text(row: EffectInfo) -> str:
    """Return the sentence on why an effect has its level, with the estimated error."""
    forced = "forced by the scene; " if row.forced else ""
    about = f"about {format_share(row.error_estimate)}: " if row.error_estimate else ""
    return _sentence(f"{forced}{about}{row.why}")


def effect_colour(row: EffectInfo) -> str:
    if row.forced:
        return SIMULATED
    return TEXT if row.on else FAINT


def _tip(row: EffectInfo) -> str:
    forced = "forced by the scene" if row.forced else ""
    source = f"source: {row.source}" if row.source else ""
    sentences = (row.physics, row.why, f"error {row.error_source}", source, forced)
    return "\n".join(_sentence(text) for text in sentences if text)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
