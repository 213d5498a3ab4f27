"""A line on a run's times, all by the clock on the wall: elapsed, left, and its end."""

from __future__ import annotations

import time
from datetime import datetime, timedelta

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QLabel, QWidget

from labapp.runs.state import State
from labapp.window.duration_text import format_duration
from labapp.window.messages import RunInfo


class RunTimes(QLabel):
    """Show a run's times in one line, which is updated also while the engine reports nothing.

    The tool tip has the times on the bench's own clock, which a virtual bench runs faster.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("faint")
        self._run: RunInfo | None = None
        self._heard = 0.0
        self._clock = "the bench's clock"
        self._timer = QTimer(self, interval=1000)
        self._timer.timeout.connect(self._update)

    def set_virtual(self, on: bool) -> None:
        """Set whether the bench has a virtual clock, which runs faster than real time."""
        self._clock = "the virtual bench's clock" if on else "the bench's clock"

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
        took = f", took {format_duration(run.bench_seconds)}" if run.bench_seconds else ""
        expected = format_duration(run.expected_bench_seconds)
        self.setToolTip(f"By {self._clock}: expected {expected}{took}")
        if not run.state.is_under_way:
            elapsed = run.elapsed_seconds
            self.setText(f"took {format_duration(elapsed)}" if elapsed else "")
            return
        since = time.monotonic() - self._heard
        parts = [f"{format_duration(run.elapsed_seconds + since)} elapsed"]
        if run.state is State.PAUSED:
            parts.append("waits for you")
        elif run.seconds_left is None:
            parts.append("time left not known yet")
        else:
            left = max(0.0, run.seconds_left - since)
            end = datetime.now() + timedelta(seconds=left)
            parts.append(f"{format_duration(left)} left, until {end:%H:%M}")
        self.setText("  ·  ".join(parts))
