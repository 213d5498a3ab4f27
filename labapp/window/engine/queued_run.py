"""A run in the queue, with its state and its progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.interfaces import Frame
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import RunOutcome
from labapp.runs.shots import Shot
from labapp.runs.state import State
from labapp.window.engine.timing import RunTiming
from labapp.window.messages import RunInfo
from optics.progress import Progress

TakeRun = Callable[[Attendance], RunOutcome]
"""run_plan() or resume_run() with all arguments bound but the attendance."""

_PAUSED_PREFIX = "PAUSED: "
"""Start of a run's message while it is paused; the reason follows."""

_UNPLUGGED_PREFIX = "UNPLUGGED: "
"""Start of a run's message while devices are unplugged; their names follow."""


class QueuedRun:
    """Keep the state of a run in the queue; any thread may read `info`.

    `on_change` is called after each change. The thread that owns the bench calls `on_pause` when
    the run is paused, and `on_plug_change` when a device was unplugged or plugged in.
    timing: for the frames that the record lacks.
    planned_frames: all frames of the record.
    stored_frames: those that it already has.
    """

    def __init__(
        self,
        title: str,
        path: Path,
        take: TakeRun,
        timing: RunTiming,
        *,
        planned_frames: int,
        stored_frames: int,
        ticket: str = "",
    ) -> None:
        self.title, self.path, self.take = title, path, take
        self.ticket = ticket
        self.number = 0
        self.state = State.WAITING
        self.progress = Progress(self._on_progress)
        self.on_change: Callable[[], None] = lambda: None
        self.on_pause: Callable[[], None] = lambda: None
        self.on_plug_change: Callable[[], None] = lambda: None
        self._unplugged = False
        self._planned, self._stored = planned_frames, stored_frames
        self._timing = timing
        self._message, self._fraction, self._took = "", 0.0, 0.0

    def mark_started(self) -> None:
        self.state, self._message = State.RUNNING, "starting the run …"
        self._timing.begin()

    def replan(self, shots: Sequence[Shot]) -> None:
        """Take over the frames that the run has after metering."""
        self._planned = len(shots)
        self._timing.replan(shots)
        self.on_change()

    def mark_paused(self, message: str) -> None:
        self.state, self._message = State.PAUSED, message
        self._timing.rest()
        self.on_change()
        self.on_pause()

    def mark_resumed(self) -> None:
        self.state, self._message = State.RUNNING, "goes on …"
        self._timing.go_on()
        self.on_change()

    def set_paused(self, on: bool) -> None:
        """Pause the run after its current frame, or let it go on; any thread may call this."""
        if not on and self.progress.is_paused and self.state is State.PAUSED:
            self.mark_resumed()
        (self.progress.pause if on else self.progress.resume)()
        self.on_change()

    def count_stored_frame(self, shot: Shot, frame: Frame) -> None:
        """Count a frame that was stored in the record."""
        self.state = State.RUNNING
        self._stored += 1
        self._timing.go_on()
        self._timing.count_frame()
        self.on_change()

    def mark_ended(self, state: State, message: str, took: float = 0.0) -> None:
        self.state, self._message, self._took = state, message, took
        self._fraction = 1.0 if state is State.COMPLETE else self._fraction
        self._timing.end(complete=state is State.COMPLETE)

    @property
    def info(self) -> RunInfo:
        under_way = self.state.is_under_way
        return RunInfo(
            number=self.number,
            title=self.title,
            path=self.path,
            state=self.state,
            message=self._message,
            stored_frames=self._stored,
            planned_frames=self._planned,
            fraction=self._fraction,
            expected_bench_seconds=self._timing.expected_bench_seconds,
            bench_seconds=self._took,
            elapsed_seconds=self._timing.elapsed_seconds,
            seconds_left=None if self.state.has_ended else self._timing.seconds_left,
            pause_requested=under_way and self.progress.is_paused,
            ticket=self.ticket,
        )

    def _on_progress(self, fraction: float, message: str) -> None:
        self._fraction = fraction
        if message.startswith(_PAUSED_PREFIX):
            self.mark_paused(message.removeprefix(_PAUSED_PREFIX))
        else:
            self.state, self._message = State.RUNNING, message
            self.on_change()
        if (unplugged := message.startswith(_UNPLUGGED_PREFIX)) != self._unplugged:
            self._unplugged = unplugged
            self.on_plug_change()
