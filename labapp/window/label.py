"""Labels, and the looks that the theme gives them by name."""

from __future__ import annotations

from PySide6.QtWidgets import QLabel, QWidget


def label(parent: QWidget, text: str = "", *, look: str = "", wrap: bool = False) -> QLabel:
    """look: a name that the theme's sheet knows: "faint", "readBack", "caption" ..."""
    made = QLabel(text, parent)
    made.setObjectName(look)
    made.setWordWrap(wrap)
    return made


def mark(shown: QLabel, differs: bool) -> None:
    """Colour a value that isn't what was asked for."""
    if shown.property("differs") != differs:
        shown.setProperty("differs", differs)
        shown.style().unpolish(shown)
        shown.style().polish(shown)
