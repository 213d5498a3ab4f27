"""The base of all panels, and functions for their labels, buttons and layouts."""

from __future__ import annotations

from html import escape

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QBoxLayout, QLabel, QLayout, QSizePolicy, QToolButton, QWidget

LayoutPart = QWidget | QLayout
Margins = tuple[int, int, int, int]

PANEL_MARGINS: Margins = (8, 4, 8, 6)
"""Margins of a panel in pixels: left, top, right and bottom."""

BEGINS, STOPS = "begins", "stops"
"""Properties of a panel's buttons. One begins something with what Settings shows, which a click
sets first; the other ends something, and never waits for a text that a field refuses."""


class WrappingPanel(QWidget):
    """Request the height that a panel's wrapped texts need at its width.

    A dock asks its panel only for a minimum size, not for the height at a width.
    """

    def minimumSizeHint(self) -> QSize:
        least, layout = super().minimumSizeHint(), self.layout()
        if layout is None or not layout.hasHeightForWidth():
            return least
        width = max(self.width(), least.width())
        return least.expandedTo(QSize(0, layout.minimumHeightForWidth(width)))


def make_label(
    parent: QWidget, text: str = "", *, look: str = "", wrap: bool = False, rich: bool = False
) -> QLabel:
    """Create a label; its text is shown as it is.

    look: name of the theme's style sheet, as "faint".
    rich: whether the text is HTML, in which names must be escaped.
    """
    made = QLabel(parent)
    made.setTextFormat(Qt.TextFormat.RichText if rich else Qt.TextFormat.PlainText)
    made.setText(text)
    made.setObjectName(look)
    made.setWordWrap(wrap)
    return made


def plain_tip(text: str) -> str:
    """Return a tip that shows a text as it is; Qt takes some texts for HTML."""
    if "<" not in text:
        return text
    return f'<span style="white-space: pre-wrap">{escape(text)}</span>'


def mark_property(widget: QWidget, name: str, on: bool) -> None:
    """Set a property of a widget by which the style sheet changes its look."""
    if bool(widget.property(name)) != on:
        widget.setProperty(name, on)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


def mark_difference(value_label: QLabel, differs: bool) -> None:
    """Colour a label if its value differs from the requested one."""
    mark_property(value_label, "differs", differs)


def make_tool_button(
    parent: QWidget, action: QAction, *, wide: bool = False, look: str = ""
) -> QToolButton:
    """Create a button for an action; a wide one takes all the width it can.

    look: name of the theme's style sheet: "flat" is no higher than a line of text.
    """
    made = QToolButton(parent)
    made.setObjectName(look)
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
    """Put widgets and layouts into a row or a column.

    A part may come with a stretch factor; a number alone is empty room with that factor.
    """
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
