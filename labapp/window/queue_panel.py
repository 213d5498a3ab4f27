"""Panel of the run queue, with buttons to remove, clear and release runs."""

from __future__ import annotations

from collections.abc import Sequence

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
from labapp.window.run_table import RunTable
from labapp.window.widgets import (
    PANEL_MARGINS,
    WrappingPanel,
    fill_layout,
    make_label,
    make_tool_button,
)


class QueuePanel(WrappingPanel):
    """Show the run queue.

    `remove_requested` is emitted with the numbers of waiting runs to be removed, `clear_requested`
    when ended runs are to be removed, and `release_requested` when the next run is to begin
    although the last one failed or was cancelled.
    """

    remove_requested = Signal(tuple)
    clear_requested = Signal()
    release_requested = Signal()

    def __init__(self, actions: Sequence[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.table = RunTable(self)
        self.remove = QPushButton("Remove", self)
        self.remove.setToolTip("Take the selected runs that wait out of the line (Del)")
        self.clear = QPushButton("Clear ended", self)
        self.clear.setToolTip("Take runs that have ended off the list; their files stay")
        self.hold_bar = QWidget(self)
        self.hold_bar.setObjectName("call")
        self.held_text = make_label(self.hold_bar, wrap=True)
        self.release_button = QPushButton("Go on", self.hold_bar)
        self._queue = QueueState(())
        self._arrange(actions)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._allow())
        self.remove.clicked.connect(self._remove)
        self.clear.clicked.connect(self.clear_requested)
        self.release_button.clicked.connect(self.release_requested)
        delete = QShortcut(QKeySequence(Qt.Key.Key_Delete), self.table)
        delete.setContext(Qt.ShortcutContext.WidgetShortcut)
        delete.activated.connect(self._remove)
        self._allow()

    def show_queue(self, queue: QueueState) -> None:
        self._queue = queue
        self.table.show_runs(queue.runs)
        self.hold_bar.setVisible(bool(queue.hold_reason))
        waiting = "1 run waits" if queue.waiting_count == 1 else f"{queue.waiting_count} runs wait"
        self.held_text.setText(f"Held: {queue.hold_reason}. {waiting}.")
        self._allow()

    @property
    def resumable_run(self) -> RunInfo | None:
        """Return the selected run if it can be resumed, else None."""
        ended = (State.CANCELLED, State.FAILED)
        return next((run for run in self.table.selected_runs if run.state in ended), None)

    def _arrange(self, actions: Sequence[QAction]) -> None:
        self.buttons = {one.objectName(): make_tool_button(self, one, wide=True) for one in actions}
        above = fill_layout(QHBoxLayout(), *((button, 1) for button in self.buttons.values()))
        below = fill_layout(QHBoxLayout(), self.remove, self.clear, 1)
        fill_layout(
            QHBoxLayout(self.hold_bar),
            (self.held_text, 1),
            self.release_button,
            margins=(8, 3, 4, 3),
        )
        self.hold_bar.hide()
        parts = above, (self.table, 1), self.hold_bar, below
        fill_layout(QVBoxLayout(self), *parts, margins=PANEL_MARGINS, spacing=5)

    def _waiting(self) -> tuple[int, ...]:
        selected = self.table.selected_runs
        return tuple(run.number for run in selected if run.state is State.WAITING)

    def _remove(self) -> None:
        if numbers := self._waiting():
            self.remove_requested.emit(numbers)

    def _allow(self) -> None:
        self.remove.setEnabled(bool(self._waiting()))
        self.clear.setEnabled(any(run.state.has_ended for run in self._queue.runs))
