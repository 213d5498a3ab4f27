"""Menus, declared once as lists of actions."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtGui import QAction
from PySide6.QtWidgets import QMenu, QMenuBar, QWidget

SEPARATOR = ""
"""Stands for a line in a menu."""

MENUS: Mapping[str, tuple[str, ...]] = {
    "&Run": ("acquire", "plan", "resume", SEPARATOR, "pause", "cancel", "yes", SEPARATOR, "quit"),
    "&Bench": ("live", SEPARATOR, "undo", "redo", "lock"),
    "&Picture": ("reconstruct", "open", SEPARATOR, "contrast", "marks"),
    "&View": ("why", "align", "accept", SEPARATOR, "dim", "red"),
    "P&anels": ("reset", SEPARATOR),
    "&Help": ("help", "keys"),
}
"""Names of the actions of each menu. Every action is in one of them."""


class MenuBar(QMenuBar):
    """Show the menus; `menus` has them by their titles, without the underlined letter."""

    def __init__(self, actions: Mapping[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setNativeMenuBar(False)
        self.menus: dict[str, QMenu] = {}
        for title, names in MENUS.items():
            menu = self.addMenu(title)
            menu.setToolTipsVisible(True)
            self.menus[title.replace("&", "")] = menu
            for name in names:
                if name == SEPARATOR:
                    menu.addSeparator()
                else:
                    menu.addAction(actions[name])
