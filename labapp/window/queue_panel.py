"""The queue: the runs in line, and what can be done about them."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QHBoxLayout,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from labapp.runs.state import State
from labapp.window.messages import QueueState, RunInfo
from labapp.window.parts import OF_A_PANEL, Panel, fill, label, tool_button
from labapp.window.run_table import RunTable


class QueuePanel(Panel):
    """remove_asked: numbers of runs that wait. clear_asked: runs that have ended.

    go_on_asked: the person wants the next run, though the last one didn't end well.
    """

    remove_asked = Signal(tuple)
    clear_asked = Signal()
    go_on_asked = Signal()

    def __init__(self, actions: list[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.table = RunTable(self)
        self.remove = QPushButton("Remove", self)
        self.remove.setToolTip("Take the selected runs that wait out of the line (Del)")
        self.clear = QPushButton("Clear ended", self)
        self.clear.setToolTip("Take runs that have ended off the list; their files stay")
        self.held = QWidget(self)
        self.held.setObjectName("call")
        self.held_text = label(self.held, wrap=True)
        self.go_on = QPushButton("Go on", self.held)
        self._queue = QueueState(())
        self._arrange(actions)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._allow())
        self.remove.clicked.connect(self._remove)
        self.clear.clicked.connect(self.clear_asked)
        self.go_on.clicked.connect(self.go_on_asked)
        delete = QShortcut(QKeySequence(Qt.Key.Key_Delete), self.table)
        delete.setContext(Qt.ShortcutContext.WidgetShortcut)
        delete.activated.connect(self._remove)
        self._allow()

    def show_queue(self, queue: QueueState) -> None:
        self._queue = queue
        self.table.show_runs(queue.runs)
        self.held.setVisible(bool(queue.held))
        waiting = "1 run waits" if queue.waiting == 1 else f"{queue.waiting} runs wait"
        self.held_text.setText(f"Held: {queue.held}. {waiting}.")
        self._allow()

    @property
    def unfinished(self) -> RunInfo | None:
        """The run that the person has selected, if it can be resumed."""
        ended = (State.CANCELLED, State.FAILED)
        return next((run for run in self.table.selected if run.state in ended), None)

    def _arrange(self, actions: list[QAction]) -> None:
        self.buttons = {one.objectName(): tool_button(self, one, wide=True) for one in actions}
        above = fill(QHBoxLayout(), *((button, 1) for button in self.buttons.values()))
        below = fill(QHBoxLayout(), self.remove, self.clear, 1)
        fill(QHBoxLayout(self.held), (self.held_text, 1), self.go_on, margins=(8, 3, 4, 3))
        self.held.hide()
        parts = above, (self.table, 1), self.held, below
        fill(QVBoxLayout(self), *parts, margins=OF_A_PANEL, spacing=5)

    def _waiting(self) -> tuple[int, ...]:
        selected = self.table.selected
        return tuple(run.number for run in selected if run.state is State.WAITING)

    def _remove(self) -> None:
        if numbers := self._waiting():
            self.remove_asked.emit(numbers)

    def _allow(self) -> None:
        self.remove.setEnabled(bool(self._waiting()))
        self.clear.setEnabled(any(run.state.has_ended for run in self._queue.runs))
