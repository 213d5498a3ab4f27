"""Requests about runs from the window to the engine: to queue, pause, resume and remove them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from labapp.window.actions import retitle
from labapp.window.engine_connection import EngineConnection
from labapp.window.messages import (
    AcquireBracket,
    AnswerPrompt,
    ClearEndedRuns,
    PauseRun,
    QueueState,
    ReleaseQueue,
    RemoveRuns,
    ResumeRun,
    RunPlan,
)

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow


class RunRequests(QObject):
    """Turn actions and the queue's buttons into commands to the engine.

    The engine chooses the names of the records.
    """

    def __init__(self, window: MainWindow, connection: EngineConnection) -> None:
        super().__init__(window)
        self._window, self._send = window, connection.send
        self._queue = QueueState(())
        actions, queue, send = window.actions_, window.queue, connection.send
        actions["acquire"].triggered.connect(self._acquire)
        actions["plan"].triggered.connect(self._run_plan)
        actions["resume"].triggered.connect(self._resume)
        actions["pause"].triggered.connect(self._pause)
        queue.remove_requested.connect(lambda numbers: send(RemoveRuns(numbers)))
        queue.clear_requested.connect(lambda: send(ClearEndedRuns()))
        queue.release_requested.connect(lambda: send(ReleaseQueue()))
        window.prompt_bar.prompt_done.connect(lambda number: send(AnswerPrompt(number)))

    def show_queue(self, queue: QueueState) -> None:
        self._queue = queue
        run = queue.current_run
        pausing = run is not None and run.pause_requested
        retitle(self._window.actions_["pause"], "Resume" if pausing else "Pause")

    def _acquire(self) -> None:
        run = self._window.run
        self._enqueue(
            AcquireBracket(
                pattern=self._window.pattern.pattern_table(),
                wavelength=self._window.settings.wavelength.value() * 1e-9,
                star=run.star.bracket,
                photograph=run.photograph.bracket,
                folder=run.chosen_folder,
            ),
            "The bracket is put in line …",
        )

    def _run_plan(self) -> None:
        plan = self._choose("Plan to run", "", "Plans (*.toml *.json)")
        if plan:
            said = f"{plan} is read and put in line …"
            self._enqueue(RunPlan(plan, self._window.run.chosen_folder), said)

    def _resume(self) -> None:
        selected = self._window.queue.resumable_run
        first = str(selected.path) if selected else str(self._window.run.chosen_folder)
        path = self._choose("Unfinished run to resume", first, "Runs (*.h5)")
        if path:
            self._enqueue(ResumeRun(path), f"{path} is put in line …")

    def _choose(self, title: str, first: str, kinds: str) -> Path | None:
        path, _ = QFileDialog.getOpenFileName(self._window, title, first, kinds)
        return Path(path) if path else None

    def _enqueue(self, command: AcquireBracket | RunPlan | ResumeRun, message: str) -> None:
        window = self._window
        window.message.show_message(message)
        if not self._queue.is_busy:
            window.tabs.setCurrentWidget(window.live_view)
        # No field keeps the focus, so that Enter answers the run's prompts.
        if (field := window.focusWidget()) is not None:
            field.clearFocus()
        self._send(command)

    def _pause(self) -> None:
        run = self._queue.current_run
        if run is not None:
            self._send(PauseRun(not run.pause_requested))
