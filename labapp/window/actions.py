"""What a person can do, declared once; tool bar, buttons and shortcuts use the same actions."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMainWindow


@dataclass(frozen=True)
class Declared:
    """An action: its text, its key, and what it does in a sentence."""

    name: str
    text: str
    key: str
    tip: str
    checkable: bool = False


DECLARED = (
    Declared("live", "Live", "F5", "Take one picture after the other", checkable=True),
    Declared("acquire", "Acquire bracket", "F6", "Take the bracket into a new file"),
    Declared("reconstruct", "Reconstruct", "F7", "Undo the coding of the last complete run"),
    Declared("cancel", "Cancel", "Esc", "Stop the run or the computation"),
    Declared("open", "Open run …", "Ctrl+O", "Reconstruct a run that was taken earlier"),
    Declared("contrast", "Auto contrast", "A", "Contrast follows the picture", checkable=True),
    Declared("marks", "Clipping marks", "C", "Saturated red, zero blue", checkable=True),
    Declared("reset", "Reset layout", "", "Put every panel back where it was"),
)


class Actions:
    """The actions of a window, by name."""

    def __init__(self, window: QMainWindow) -> None:
        self._actions = {declared.name: _make(declared, window) for declared in DECLARED}
        window.addActions(list(self._actions.values()))

    def __getitem__(self, name: str) -> QAction:
        return self._actions[name]


def _make(declared: Declared, window: QMainWindow) -> QAction:
    key = f"  {declared.key}" if declared.key else ""
    action = QAction(declared.text + key, window, checkable=declared.checkable)
    action.setObjectName(declared.name)
    action.setToolTip(declared.tip)
    if declared.key:
        action.setShortcut(QKeySequence(declared.key))
    return action
