"""The bar at the top of the window: buttons for the actions, and the simulation badge."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QFrame, QHBoxLayout, QToolButton, QWidget

from labapp.window.simulation_badge import SimulationBadge
from labapp.window.widgets import make_tool_button

_GROUPS = (
    ("live",),
    ("acquire", "pause", "cancel"),
    ("reconstruct",),
    ("contrast", "marks"),
    ("why", "reset"),
)


class ActionBar(QWidget):
    """Show the window's action buttons and the simulation badge, which must never be hidden.

    It is no QToolBar: a person can hide a QToolBar, and it hides the buttons that don't fit.
    """

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.badge = SimulationBadge(self)
        self.buttons: dict[str, QToolButton] = {}
        layout = QHBoxLayout(self)
        layout.setContentsMargins(6, 5, 6, 5)
        layout.setSpacing(4)
        for group in _GROUPS:
            for name in group:
                button = make_tool_button(self, actions[name])
                button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
                self.buttons[name] = button
                layout.addWidget(button)
            line = QFrame(self)
            line.setFixedWidth(6)
            layout.addWidget(line)
        layout.addStretch(1)
        layout.addWidget(self.badge)
