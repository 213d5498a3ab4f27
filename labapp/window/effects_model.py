"""What the simulator does and why, as rows of a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QObject, Qt

from labapp.window.messages import EffectTold
from labapp.window.rows import Index, RowsModel
from labapp.window.theme import FAINT, SIMULATED, TEXT

_COLUMNS = {
    "Effect": "Whatever optics and electronics of this bench could do to the picture, in the "
    "light's order",
    "Level": "How far the simulator goes: faint is off, amber is forced by the scene",
    "Changes at most": "Beyond that level, relative to the picture. The bar is logarithmic, from "
    "1e-7 to 1; the line is the tolerance, which all effects share",
}


class EffectsModel(RowsModel):
    """The effects of one picture, in the order of the light."""

    rows: Sequence[EffectTold]

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(_COLUMNS, parent)

    def show_rows(self, rows: tuple[EffectTold, ...]) -> None:
        """Rows that are of the same effects as before stay where the person has scrolled to."""
        if [row.name for row in rows] != [row.name for row in self.rows]:
            self.beginResetModel()
            self.rows = rows
            self.endResetModel()
        else:
            self.rows = rows
            self.tell_all_changed()

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.DisplayRole:
            return (row.name, row.level, limit(row))[index.column()]
        return _tip(row) if role == Qt.ItemDataRole.ToolTipRole else None


def share(number: float) -> str:
    """A relative change as a person reads it: 0.18, 4e-3, 1.2e-5, 0."""
    if number == 0 or number >= 0.1:
        return f"{number:.2g}"
    digits, power = f"{number:.1e}".split("e")
    return f"{digits.removesuffix('.0')}e{int(power)}"


def limit(row: EffectTold) -> str:
    if row.at_most is None:
        return "no limit known"
    return share(row.at_most) if row.at_most else "nothing"


def reason(row: EffectTold) -> str:
    """Why an effect is at its level, with what the level is likely to change."""
    forced = "forced by the scene; " if row.forced else ""
    about = f"about {share(row.about)}: " if row.about else ""
    return _sentence(f"{forced}{about}{row.why}")


def colour(row: EffectTold) -> str:
    if row.forced:
        return SIMULATED
    return TEXT if row.on else FAINT


def _tip(row: EffectTold) -> str:
    forced = "forced by the scene" if row.forced else ""
    source = f"source: {row.source}" if row.source else ""
    sentences = (row.physics, row.why, f"limit {row.how}", source, forced)
    return "\n".join(_sentence(text) for text in sentences if text)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
