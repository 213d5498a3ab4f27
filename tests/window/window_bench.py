"""A window with an engine of its own, on a bench from files."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

from PySide6.QtWidgets import QApplication

from labapp.window.engine_connection import EngineConnection
from labapp.window.frame_reduction import ReducedFrame
from labapp.window.main_window import MainWindow
from labapp.window.messages import LiveFrame, LivePicture, QueueState, RunInfo
from labapp.window.remembered_settings import RememberedSettings


def state_of(process: int) -> str:
    """As in /proc: R, S, T for one that was stopped; Z, or empty, for one that has ended."""
    try:
        status = Path(f"/proc/{process}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""
    return status.rpartition(")")[2].split()[0]


def alive(process: int) -> bool:
    return state_of(process) not in ("", "Z")


class Bench:
    """The window, its engine, the last frame that came, and how the queue stands.

    files: of the bench, as EngineConnection takes them.
    """

    def __init__(self, folder: Path, **files: Path | None) -> None:
        self.folder = folder
        self.connection = EngineConnection(**files)
        self.window = MainWindow(self.connection, RememberedSettings(folder / "window.ini"))
        self.window.run.folder.setText(str(folder / "runs"))
        self.frames = 0
        self.picture: LivePicture | None = None
        self.reports: list[Any] = []
        self.connection.report_received.connect(self._hear)
        self.window.show()
        self.connection.start()

    def _hear(self, report: Any) -> None:
        # A prediction is no frame of a camera; it is kept among the reports.
        if isinstance(report, LivePicture) and not report.is_prediction:
            self.frames, self.picture = self.frames + 1, report
        else:
            self.reports.append(report)

    @property
    def frame(self) -> LiveFrame | None:
        """The raw frame that came last."""
        return self.picture and self.picture.frame

    @property
    def shown(self) -> ReducedFrame | None:
        """What the window shows of it."""
        return self.picture and self.picture.shown

    def last(self, kind: type) -> Any:
        return next((r for r in reversed(self.reports) if isinstance(r, kind)), None)

    @property
    def runs(self) -> list[RunInfo]:
        """As the table in the window has them."""
        return list(self.window.queue.table.runs.rows)

    @property
    def states(self) -> list[str]:
        return [run.state.value for run in self.runs]

    @property
    def stored(self) -> int:
        """Frames of the run under way."""
        run = self.window.session.queue.current_run
        return run.stored_frames if run else 0

    @property
    def idle(self) -> bool:
        """Whether nothing is under way that an earlier test may have left."""
        session = self.window.session
        runs = session.queue.is_busy or bool(session.queue.hold_reason)
        return not (runs or session.job or QApplication.activeModalWidget())

    def describe(self) -> str:
        """How everything stands that a test may wait for."""
        frame, window = self.frame, self.window
        shown = "no frame"
        if frame is not None:
            shown = (
                f"frame {self.frames}: {frame.target}, {frame.pattern}, "
                f"{frame.wavelength * 1e9:.2f} nm, {frame.exposure * 1e3:g} ms"
            )
        queue = window.session.queue
        return "\n".join(
            [
                shown,
                f"runs: {self.states}, {self.stored} frames stored, held: {queue.hold_reason!r}",
                f"call: {window.prompt_bar.text!r}",
                f"message: {window.message.text!r}",
                f"engine: {self.connection.process_id or 'none'}",
            ]
        )

    def close(self, *, kill: bool = False) -> None:
        """Without a question, whatever is under way. kill: without waiting for the engine."""
        if kill and (engine := self.connection.process_id):
            os.kill(engine, signal.SIGKILL)
        self.connection.close()
        self.window.session.show_queue(QueueState(()))
        self.window.close()
