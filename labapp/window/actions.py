"""The actions, declared once; menus, buttons and shortcuts use the same ones.

Menus show an action's text and its shortcut; buttons show both as the action's icon text. An action
that begins something first sets what is typed, and waits where a field refuses its text.
"""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import Signal
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMainWindow

from labapp.window.commit_fields import finish_typing


@dataclass(frozen=True)
class ActionSpec:
    """An action's button text, shortcut and tool tip.

    begins: whether it starts something that uses what the fields hold.
    """

    name: str
    text: str
    shortcut: str
    tip: str
    checkable: bool = False
    begins: bool = False


class Action(QAction):
    """Emit `performed` once the action goes ahead.

    `triggered` comes before that, also where a field's refused text keeps the action from going on.
    """

    performed = Signal(bool)

    def __init__(self, window: QMainWindow, declared: ActionSpec) -> None:
        super().__init__(window, checkable=declared.checkable)
        self._window, self._begins = window, declared.begins
        self.triggered.connect(self._perform)

    def _perform(self, on: bool) -> None:
        if finish_typing(self._window, proposals=self._begins) or not self._begins:
            self.performed.emit(on)
        else:
            self.setChecked(self.isCheckable() and not on)


ACTION_SPECS = (
    ActionSpec(
        "live", "Live", "F5", "Take one picture after the other", checkable=True, begins=True
    ),
    ActionSpec(
        "acquire",
        "Acquire bracket",
        "F6",
        "Put the bracket in line, into a new file",
        begins=True,
    ),
    ActionSpec(
        "reconstruct", "Reconstruct", "F7", "Undo the last run's blur, as you choose", begins=True
    ),
    ActionSpec("pause", "Pause", "F8", "Let the run rest after its frame, or go on"),
    ActionSpec("cancel", "Cancel", "Esc", "Stop the computation, or the run after a question"),
    ActionSpec("yes", "Yes", "Ctrl+Return", "Answer the question above the picture with yes"),
    ActionSpec("undo", "Undo", "Ctrl+Z", "Set the bench as it was before the last setting"),
    ActionSpec("redo", "Redo", "Ctrl+Y", "Make the setting again that was undone"),
    ActionSpec("lock", "Lock", "Ctrl+L", "Keep the bench as it is: nothing moves", checkable=True),
    ActionSpec("plan", "Run plan …", "Ctrl+P", "Put the run of a plan file in line", begins=True),
    ActionSpec(
        "resume", "Resume run …", "Ctrl+R", "Take the frames that a record lacks", begins=True
    ),
    ActionSpec(
        "open",
        "Open run …",
        "Ctrl+O",
        "See a run taken earlier, and reconstruct it",
        begins=True,
    ),
    ActionSpec("contrast", "Auto contrast", "A", "Contrast follows the picture", checkable=True),
    ActionSpec("marks", "Clipping marks", "C", "Saturated red, zero blue", checkable=True),
    ActionSpec("why", "Why", "W", "What the simulator does and why, or the queue", checkable=True),
    ActionSpec("align", "Find and align", "F9", "Focus, expose and measure what is live"),
    ActionSpec("help", "Help", "F1", "Read the guide: how to do things, and how they work"),
    ActionSpec("keys", "Keys", "Shift+F1", "List all keys, and what they do"),
    ActionSpec("accept", "Acknowledge error", "Ctrl+E", "Take the error off the bottom line"),
    ActionSpec("dim", "Dimmer", "Ctrl+D", "Everything darker, pictures too", checkable=True),
    ActionSpec(
        "red", "Red light", "Ctrl+Shift+D", "Red, for eyes used to the dark", checkable=True
    ),
    ActionSpec("reset", "Reset layout", "", "Put every panel back where it was"),
    ActionSpec("quit", "Quit", "Ctrl+Q", "Close the window, and leave the bench safe"),
)
"""All actions. Each has a place in labapp.window.menus, and many a button, too."""


def make_actions(window: QMainWindow) -> dict[str, Action]:
    """Create all actions, by name."""
    actions = {declared.name: _make(declared, window) for declared in ACTION_SPECS}
    window.addActions(list(actions.values()))
    return actions


def retitle(action: QAction, text: str) -> None:
    """Change an action's text in menus and on buttons; its shortcut stays."""
    key = action.shortcut().toString()
    action.setText(text)
    # Combinations of keys are long; menus and tips have them.
    action.setIconText(_with_shortcut(text, "" if "+" in key else key))


def _with_shortcut(text: str, key: str) -> str:
    return f"{text}  {key}" if key else text


def _make(declared: ActionSpec, window: QMainWindow) -> Action:
    action = Action(window, declared)
    action.setObjectName(declared.name)
    if declared.shortcut:
        action.setShortcut(QKeySequence(declared.shortcut))
    retitle(action, declared.text)
    action.setToolTip(_with_shortcut(declared.tip, declared.shortcut and f"({declared.shortcut})"))
    return action
