"""The list of keys, made from the actions."""

from __future__ import annotations

from collections.abc import Iterable

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QAbstractItemView,
    QDialog,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from labapp.window.widgets import fill_layout

_OTHER_KEYS = (
    ("Enter", "Confirm what a run asks for, where no field has the focus"),
    ("Ctrl+1 … Ctrl+8", "Go to a panel: Devices, Pattern, Settings, and so on"),
    ("Ctrl+Tab", "The next tab, where a tab has the focus"),
    ("Tab, Shift+Tab", "The next field or button, or the one before"),
    ("Alt and a letter", "The menu whose title has that letter underlined"),
    ("Del", "Take the selected runs out of the line"),
)
"""Keys that belong to no action, and what they do."""


class ShortcutList(QDialog):
    """List every key beside what it does."""

    def __init__(self, actions: Iterable[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("labapp: keys")
        self.list = QTreeWidget(self)
        self.list.setHeaderLabels(["Key", "What it does"])
        self.list.setRootIsDecorated(False)
        self.list.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        for action in actions:
            if key := action.shortcut().toString():
                words = action.toolTip().removesuffix(f"  ({key})")
                self._add(key, f"{action.text()}: {words}")
        for key, words in _OTHER_KEYS:
            self._add(key, words)
        self.list.resizeColumnToContents(0)
        fill_layout(QVBoxLayout(self), self.list, margins=(8, 8, 8, 8))
        self.resize(640, 520)
        self.list.setFocus(Qt.FocusReason.OtherFocusReason)

    def _add(self, key: str, words: str) -> None:
        QTreeWidgetItem(self.list, [key, words])
