"""The window's line on a run's times: expected, elapsed and left."""

from __future__ import annotations

import time

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QLabel, QWidget

from labapp.runs.state import State
from labapp.window.duration_text import format_duration
from labapp.window.messages import RunInfo


class RunTimes(QLabel):
    """Show a run's times in one line, which is updated also while the engine reports nothing."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("faint")
        self._run: RunInfo | None = None
        self._heard = 0.0
        self._unit = ""
        self._timer = QTimer(self, interval=1000)
        self._timer.timeout.connect(self._update)

    def set_virtual(self, on: bool) -> None:
        """Set whether the window's bench has a virtual clock, which runs faster than real time."""
        self._unit = " of bench time" if on else ""

    def show_run(self, run: RunInfo) -> None:
        self._run, self._heard = run, time.monotonic()
        if run.state.is_under_way:
            self._timer.start()
        else:
            self._timer.stop()
        self._update()

    def _update(self) -> None:
        run = self._run
        if run is None:
            return
        expected = f"Expected {format_duration(run.expected_bench_seconds)}"
        if not run.state.is_under_way:
            took = f", took {format_duration(run.bench_seconds)}" if run.bench_seconds else ""
            self.setText(f"{expected}{took}{self._unit}")
            return
        since = time.monotonic() - self._heard
        parts = [
            f"{expected}{self._unit}",
            f"elapsed {format_duration(run.elapsed_seconds + since)}",
        ]
        if run.seconds_left is not None:
            passed = since if run.state is State.RUNNING else 0.0
            parts.append(f"{format_duration(max(0.0, run.seconds_left - passed))} left")
        self.setText("  ·  ".join(parts))
