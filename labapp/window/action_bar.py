"""Menus beside the simulation badge at the window's top, and buttons for the actions."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QFrame, QHBoxLayout, QToolButton, QVBoxLayout, QWidget

from labapp.window.flow_layout import FlowLayout
from labapp.window.menus import MenuBar
from labapp.window.simulation_badge import SimulationBadge
from labapp.window.widgets import fill_layout, make_tool_button

TOOL_GROUPS = (
    ("live",),
    ("acquire", "pause", "cancel"),
    ("reconstruct",),
    ("contrast", "marks"),
    ("why", "reset"),
)
"""Names of the actions that have a button in the bar, in groups with some room between them."""


class ActionBar(QWidget):
    """Show the menus, the action buttons and the badge, which must never be hidden.

    It is no QToolBar: a person can hide a QToolBar, and it hides the buttons that don't fit.
    Buttons that don't fit beside the others go to a second row.
    """

    def __init__(self, actions: Mapping[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.menus = MenuBar(actions, self)
        self.badge = SimulationBadge(self)
        self.buttons: dict[str, QToolButton] = {}
        flow = FlowLayout(spacing=4)
        flow.setContentsMargins(6, 2, 6, 4)
        for group in TOOL_GROUPS:
            for name in group:
                button = make_tool_button(self, actions[name])
                button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
                self.buttons[name] = button
                flow.addWidget(button)
            room = QFrame(self)
            room.setFixedWidth(4)
            flow.addWidget(room)
        first = fill_layout(QHBoxLayout(), (self.menus, 1), self.badge)
        first.setContentsMargins(0, 3, 6, 0)
        fill_layout(QVBoxLayout(self), first, flow, spacing=2)
