"""`python window_victim.py FOLDER SEED`: a window that asks for runs until somebody kills it.

It opens the bench of FOLDER, and does what a person would: it restarts an engine that died, lets
held runs go on, changes the exposure, and asks for more runs. FOLDER/journal.jsonl gets a line for
whatever the window has shown: requests, stored frames, ends of runs, and what came back. With the
seed "finish" it asks for nothing, and closes once all runs have ended.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QFileDialog

from labapp.window.app import open_window
from labapp.window.messages import QueueState

_TURN = 50
"""Milliseconds between two looks at the window."""

_IN_LINE = 4
"""Runs that wait at most."""


class Victim:
    """One window, with a person who asks for much. `seed`: of what is asked; None to finish."""

    def __init__(self, folder: Path, seed: int | None) -> None:
        self._folder, self._seed = folder, seed
        self._rng = np.random.default_rng(seed)
        self._journal = os.open(folder / "journal.jsonl", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self.application, self._window, connection = open_window(
            bench=folder / "bench.toml", scene=folder / "scene.toml"
        )
        self._window.run.folder.setText(str(folder / "runs"))
        self._engine, self._back = connection, False
        self._turns = 0
        self._told: dict[str, Any] = {}
        connection.report_received.connect(self._hear)
        self._timer = QTimer(interval=_TURN)
        self._timer.timeout.connect(self._turn)
        self._timer.start()

    def _write(self, **line: Any) -> None:
        # One write a line, so that a kill can't cut one in two.
        os.write(self._journal, (json.dumps(line) + "\n").encode())

    def _hear(self, report: object) -> None:
        if not isinstance(report, QueueState):
            return
        for run in report.runs:
            said = {
                "path": str(run.path),
                "stored": run.stored_frames,
                "ended": run.state.has_ended,
            }
            if self._told.get(run.ticket) != said:
                self._told[run.ticket] = said
                self._write(run=run.ticket, **said)

    def _turn(self) -> None:
        window, queue = self._window, self._window.session.queue
        if window.message.restart.isVisible():
            self._back = False
            window.message.restart.click()
            return
        if not window.actions_["acquire"].isEnabled():
            return
        if not self._back:
            self._report_what_came_back(queue)
            return
        if window.queue.release_button.isVisible():
            window.queue.release_button.click()
        waiting = len(window.kept_queue.requests)
        if self._seed is None:
            if not waiting:
                self._write(finished=True)
                window.close()
            return
        self._turns += 1
        if waiting < _IN_LINE:
            self._ask()
        if self._turns % 40 == 0:
            window.settings.exposure.setValue(int(self._rng.integers(1, 400)))
            self._write(set=window.settings.exposure.value())
        elif self._turns % 40 == 20:
            # A second after it changed, a setting must be kept.
            self._write(exposure=window.settings.exposure.value())

    def _report_what_came_back(self, queue: QueueState) -> None:
        """Wait until every run that was kept is in line again, and note them."""
        kept = {one.request.ticket for one in self._window.kept_queue.requests}
        shown = {run.ticket for run in queue.runs}
        if kept <= shown:
            self._back = True
            self._write(back=sorted(shown), exposure=self._window.settings.exposure.value())
            print("back", flush=True)

    def _ask(self) -> None:
        plan = self._folder / f"plan-{self._rng.integers(3)}.toml"
        before = set(self._kept())
        with patch.object(QFileDialog, "getOpenFileName", return_value=(str(plan), "")):
            self._window.actions_["plan"].trigger()
        for ticket in set(self._kept()) - before:
            self._write(asked=ticket)

    def _kept(self) -> list[str]:
        return [one.request.ticket for one in self._window.kept_queue.requests]


if __name__ == "__main__":
    victim = Victim(Path(sys.argv[1]), None if sys.argv[2] == "finish" else int(sys.argv[2]))
    sys.exit(victim.application.exec())
