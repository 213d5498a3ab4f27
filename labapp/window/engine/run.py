"""One run of the queue: what it will take, and how far it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from drivers.interfaces import Frame
from labapp.runs.acquisition.runner import Outcome
from labapp.runs.state import State
from labapp.runs.steps import Shot
from labapp.window.engine.timing import Timing
from labapp.window.messages import RunInfo
from optics.progress import Progress

Take = Callable[..., Outcome]
"""run_plan() or resume_run(), with all given but progress, on_frame and ask."""

_PAUSED = "PAUSED: "
"""How a run begins to say that it rests, and why."""

_UNPLUGGED = "UNPLUGGED: "
"""How it begins to say which devices aren't there, while they aren't."""


class Run:
    """What a run reports goes into `info`, which any thread may ask for.

    planned, stored: frames of the record, and those that it has. timing: of those that it
    lacks. changed: is called after each change; in the thread that has the bench, rested: when
    the run begins to rest, and plugged: when a device was unplugged or plugged in.
    """

    def __init__(
        self, title: str, path: Path, take: Take, timing: Timing, *, planned: int, stored: int
    ) -> None:
        self.title, self.path, self.take = title, path, take
        self.number = 0
        self.state = State.WAITING
        self.progress = Progress(self._hear)
        self.changed: Callable[[], None] = lambda: None
        self.rested: Callable[[], None] = lambda: None
        self.plugged: Callable[[], None] = lambda: None
        self._unplugged = False
        self._planned, self._stored = planned, stored
        self._timing = timing
        self._message, self._fraction, self._took = "", 0.0, 0.0

    def begin(self) -> None:
        self.state, self._message = State.RUNNING, "starting the run …"
        self._timing.begin()

    def rest(self, message: str) -> None:
        self.state, self._message = State.PAUSED, message
        self._timing.rest()
        self.changed()
        self.rested()

    def go_on(self) -> None:
        self.state, self._message = State.RUNNING, "goes on …"
        self.changed()

    def pause(self, on: bool) -> None:
        """Let the run rest after its frame, or go on; from any thread."""
        if not on and self.progress.paused and self.state is State.PAUSED:
            self.go_on()
        (self.progress.pause if on else self.progress.resume)()
        self.changed()

    def stored(self, shot: Shot, frame: Frame) -> None:
        """A frame is on the disk."""
        self.state = State.RUNNING
        self._stored += 1
        self._timing.frame(shot.lasts)
        self.changed()

    def end(self, state: State, message: str, took: float = 0.0) -> None:
        self.state, self._message, self._took = state, message, took
        self._fraction = 1.0 if state is State.COMPLETE else self._fraction
        self._timing.end()

    @property
    def info(self) -> RunInfo:
        under_way = self.state.is_under_way
        return RunInfo(
            number=self.number,
            title=self.title,
            path=self.path,
            state=self.state,
            message=self._message,
            stored=self._stored,
            planned=self._planned,
            fraction=self._fraction,
            expected=self._timing.expected,
            took=self._took,
            elapsed=self._timing.elapsed,
            left=self._timing.left if under_way else None,
            pausing=under_way and self.progress.paused,
        )

    def _hear(self, fraction: float, message: str) -> None:
        self._fraction = fraction
        if message.startswith(_PAUSED):
            self.rest(message.removeprefix(_PAUSED))
        else:
            self.state, self._message = State.RUNNING, message
            self.changed()
        if (unplugged := message.startswith(_UNPLUGGED)) != self._unplugged:
            self._unplugged = unplugged
            self.plugged()
