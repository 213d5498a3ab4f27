"""A bracket, run where the bench is owned, with its frames shown on the way."""

from __future__ import annotations

from drivers.interfaces import Frame
from labapp.acquisition.runner import run_plan
from labapp.acquisition.state import State
from labapp.acquisition.steps import Shot
from labapp.bench import Bench
from labapp.window.engine.benchtop import Benchtop
from labapp.window.engine.channel import Channel
from labapp.window.engine.jobs import Jobs
from labapp.window.engine.pace import Pace
from labapp.window.engine.plan import bracket_plan
from labapp.window.messages import Acquire, LiveFrame, RunEnded
from optics.progress import Cancelled, Progress


class Acquisition:
    """Runs one bracket at a time; Cancel is heard by the channel's own thread meanwhile."""

    def __init__(
        self, bench: Bench, channel: Channel, jobs: Jobs, top: Benchtop, pace: Pace
    ) -> None:
        self._bench, self._channel, self._jobs = bench, channel, jobs
        self._top, self._pace = top, pace

    def run(self, command: Acquire) -> RunEnded:
        """How the run ended; UserError or OSError if it couldn't begin."""
        progress = self._jobs.begin("run")
        try:
            return self._run(command, progress)
        except Cancelled:
            return RunEnded(None, State.CANCELLED.value, 0, "cancelled before the first frame")
        finally:
            self._jobs.end("run", progress)

    def _run(self, command: Acquire, progress: Progress) -> RunEnded:
        plan = bracket_plan(command)
        command.path.parent.mkdir(parents=True, exist_ok=True)
        outcome = run_plan(
            self._bench,
            plan,
            command.path,
            source="bracket",
            progress=progress,
            on_frame=self._show,
        )
        missing = len(outcome.missing)
        return RunEnded(outcome.path, outcome.state.value, missing, outcome.message)

    def _show(self, shot: Shot, frame: Frame) -> None:
        """Let the window see a stored frame, if it has the time."""
        self._top.saw(frame)
        if not self._pace.due:
            return
        self._pace.begin()
        self._channel.send(self._top.state(live=False, running=True))
        seen = LiveFrame(
            image=frame.image,
            target=shot.target,
            pattern=shot.pattern,
            wavelength=self._bench.filter.wavelength,
            exposure=frame.exposure,
            number=frame.number,
        )
        self._channel.send_frame(seen)
