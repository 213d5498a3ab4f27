"""Panels, and the labels, buttons and layouts that they are made of."""

from __future__ import annotations

from PySide6.QtCore import QSize
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QBoxLayout, QLabel, QLayout, QSizePolicy, QToolButton, QWidget

LayoutPart = QWidget | QLayout
Margins = tuple[int, int, int, int]

PANEL_MARGINS: Margins = (8, 4, 8, 6)
"""Margins to the left, above, to the right and below."""


class WrappingPanel(QWidget):
    """Texts that wrap need more lines the narrower they are, which a dock doesn't ask about."""

    def minimumSizeHint(self) -> QSize:
        least, layout = super().minimumSizeHint(), self.layout()
        if layout is None or not layout.hasHeightForWidth():
            return least
        width = max(self.width(), least.width())
        return least.expandedTo(QSize(0, layout.minimumHeightForWidth(width)))


def make_label(parent: QWidget, text: str = "", *, look: str = "", wrap: bool = False) -> QLabel:
    """look: a name that the theme's sheet knows: "faint", "readBack", "caption" ..."""
    made = QLabel(text, parent)
    made.setObjectName(look)
    made.setWordWrap(wrap)
    return made


def mark_difference(value_label: QLabel, differs: bool) -> None:
    """Colour a value that isn't what was asked for."""
    if value_label.property("differs") != differs:
        value_label.setProperty("differs", differs)
        value_label.style().unpolish(value_label)
        value_label.style().polish(value_label)


def make_tool_button(parent: QWidget, action: QAction, *, wide: bool = False) -> QToolButton:
    """A button of an action; wide: it takes what room there is."""
    made = QToolButton(parent)
    made.setDefaultAction(action)
    if wide:
        made.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
    return made


def fill_layout(
    layout: QBoxLayout,
    *parts: LayoutPart | tuple[LayoutPart, int] | int,
    margins: Margins = (0, 0, 0, 0),
    spacing: int | None = None,
) -> QBoxLayout:
    """Put parts into a row or column, some with how far they stretch; a number is empty room."""
    layout.setContentsMargins(*margins)
    if spacing is not None:
        layout.setSpacing(spacing)
    for one in parts:
        if isinstance(one, int):
            layout.addStretch(one)
            continue
        part, stretch = one if isinstance(one, tuple) else (one, 0)
        if isinstance(part, QWidget):
            layout.addWidget(part, stretch)
        else:
            layout.addLayout(part, stretch)
    return layout
