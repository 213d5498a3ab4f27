"""Requests about runs to the engine: to queue, pause, resume and remove them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from labapp.window.actions import retitle
from labapp.window.commands import (
    AcquireBracket,
    AnswerPrompt,
    ClearEndedRuns,
    PauseRun,
    ReleaseQueue,
    RemoveRuns,
    RestoreQueue,
    ResumeRun,
    RunPlan,
    RunRequest,
)
from labapp.window.engine_connection import EngineConnection
from labapp.window.messages import QueueState, RequestRefused

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow


_KEPT = "in line since before the last start of the engine"
"""Why runs of an earlier session are held."""


class RunRequests(QObject):
    """Turn actions and the queue's buttons into commands to the engine.

    The engine chooses the names of the records.
    """

    def __init__(self, window: MainWindow, connection: EngineConnection) -> None:
        super().__init__(window)
        self._window, self._send = window, connection.send
        self._queue = QueueState(())
        self._kept = window.kept_queue
        actions, queue, send = window.actions_, window.queue, connection.send
        actions["acquire"].performed.connect(self._acquire)
        actions["plan"].performed.connect(self._run_plan)
        actions["resume"].performed.connect(self._resume)
        actions["pause"].performed.connect(self._pause)
        queue.remove_requested.connect(lambda numbers: send(RemoveRuns(numbers)))
        queue.clear_requested.connect(lambda: send(ClearEndedRuns()))
        queue.release_requested.connect(lambda: send(ReleaseQueue()))
        window.prompt_bar.prompt_done.connect(
            lambda number, other: send(AnswerPrompt(number, other))
        )

    def restore_kept(self) -> None:
        """Put runs that an earlier session or engine left into the new engine's queue, held."""
        if kept := self._kept.requests:
            self._send(RestoreQueue(kept, _KEPT))
            count = "1 run is" if len(kept) == 1 else f"{len(kept)} runs are"
            self._window.message.show_message(
                f"{count} in line from before. Nothing moves until you let the queue go on."
            )

    def forget_engine(self) -> None:
        """Keep the runs although the queue of the engine is gone."""
        self._kept.forget_engine()

    def refuse(self, refused: RequestRefused) -> None:
        """Forget a request for which the engine queued no run."""
        self._kept.drop(refused.ticket)

    def show_queue(self, queue: QueueState) -> None:
        self._queue = queue
        self._kept.follow(queue)
        run = queue.current_run
        pausing = run is not None and run.pause_requested
        retitle(self._window.actions_["pause"], "Resume" if pausing else "Pause")

    def _acquire(self) -> None:
        run = self._window.run
        self._window.settings.take_back_pending()
        if missing := self._window.pattern.form.missing_input:
            self._window.message.show_error(f"The pattern isn't complete: {missing}.")
            return
        self._enqueue(
            AcquireBracket(
                pattern=self._window.pattern.pattern_table(),
                wavelength=self._window.settings.wavelength.set_value * 1e-9,
                star=run.star.bracket,
                photograph=run.photograph.bracket,
                folder=run.chosen_folder,
                ticket=self._kept.new_ticket(),
            ),
            "The bracket is put in line …",
        )

    def _run_plan(self) -> None:
        plan = self._choose("Plan to run", "", "Plans (*.toml *.json)")
        if plan:
            said = f"{plan} is read and put in line …"
            folder = self._window.run.chosen_folder
            self._enqueue(RunPlan(plan, folder, self._kept.new_ticket()), said)

    def _resume(self) -> None:
        selected = self._window.queue.resumable_run
        first = str(selected.path) if selected else str(self._window.run.chosen_folder)
        path = self._choose("Unfinished run to resume", first, "Runs (*.h5)")
        if path:
            self._enqueue(ResumeRun(path, self._kept.new_ticket()), f"{path} is put in line …")

    def _choose(self, title: str, first: str, kinds: str) -> Path | None:
        path, _ = QFileDialog.getOpenFileName(self._window, title, first, kinds)
        return Path(path) if path else None

    def _enqueue(self, command: RunRequest, message: str) -> None:
        window = self._window
        # Kept before it is sent, so that no crash loses it.
        self._kept.add(command)
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
