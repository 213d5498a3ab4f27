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
    Declared("acquire", "Acquire bracket", "F6", "Put the bracket in line, into a new file"),
    Declared("reconstruct", "Reconstruct", "F7", "Undo the last run's blur, as you choose"),
    Declared("pause", "Pause", "F8", "Let the run rest after its frame, or go on"),
    Declared("cancel", "Cancel", "Esc", "Stop the run or the computation"),
    Declared("plan", "Run plan …", "Ctrl+P", "Put the run of a plan file in line"),
    Declared("resume", "Resume run …", "Ctrl+R", "Take the frames that a record lacks"),
    Declared("open", "Open run …", "Ctrl+O", "Reconstruct a run that was taken earlier"),
    Declared("contrast", "Auto contrast", "A", "Contrast follows the picture", checkable=True),
    Declared("marks", "Clipping marks", "C", "Saturated red, zero blue", checkable=True),
    Declared("why", "Why", "W", "What the simulator does and why, or the queue", checkable=True),
    Declared("reset", "Reset layout", "", "Put every panel back where it was"),
)


def make_actions(window: QMainWindow) -> dict[str, QAction]:
    """The actions of a window, by name."""
    actions = {declared.name: _make(declared, window) for declared in DECLARED}
    window.addActions(list(actions.values()))
    return actions


def retitle(action: QAction, text: str) -> None:
    """Call an action something else; its key stays."""
    action.setText(_with_key(text, action.shortcut().toString()))


def _with_key(text: str, key: str) -> str:
    return f"{text}  {key}" if key else text


def _make(declared: Declared, window: QMainWindow) -> QAction:
    text = _with_key(declared.text, declared.key)
    action = QAction(text, window, checkable=declared.checkable)
    action.setObjectName(declared.name)
    action.setToolTip(_with_key(declared.tip, declared.key and f"({declared.key})"))
    if declared.key:
        action.setShortcut(QKeySequence(declared.key))
    return action
