"""A run, where the bench is owned, with its frames shown on the way."""

from __future__ import annotations

from drivers.interfaces import Frame
from labapp.runs.state import State
from labapp.runs.steps import Shot
from labapp.window.engine.benchtop import Benchtop
from labapp.window.engine.channel import Channel
from labapp.window.engine.effects import Effects
from labapp.window.engine.pace import Pace
from labapp.window.engine.person import Person
from labapp.window.engine.run import Run
from labapp.window.messages import LiveFrame, RunEnded
from optics.progress import Cancelled, Progress


class Acquisition:
    """Takes the frames of one run at a time; pause and cancel come from other threads."""

    def __init__(
        self, channel: Channel, top: Benchtop, pace: Pace, person: Person, effects: Effects
    ) -> None:
        self._channel, self._top, self._pace, self._person = channel, top, pace, person
        self._effects = effects

    def take(self, run: Run) -> RunEnded:
        """How the run ended; UserError, DeviceError or OSError if it couldn't begin."""
        run.rested, run.plugged = self._tell, self._tell_unasked

        def on_frame(shot: Shot, frame: Frame) -> None:
            run.stored(shot, frame)
            self._show(shot, frame)

        def ask(text: str, progress: Progress) -> None:
            run.rest(text)
            self._person.ask(text, progress)
            run.go_on()

        self._top.devices.require_alive()
        try:
            outcome = run.take(progress=run.progress, on_frame=on_frame, ask=ask)
        except Cancelled:
            return RunEnded(None, State.CANCELLED, 0, "cancelled before the first frame")
        if outcome.trouble is not None:
            self._top.devices.blame(outcome.trouble)
        missing, why = len(outcome.missing), outcome.message
        return RunEnded(outcome.path, outcome.state, missing, why, outcome.took)

    def _tell(self) -> None:
        self._channel.send(self._top.state(live=False, running=True))

    def _tell_unasked(self) -> None:
        """While the run waits for a device, none is asked anything: it may be that one."""
        self._channel.send(self._top.state(live=False, running=True, anew=False))

    def _show(self, shot: Shot, frame: Frame) -> None:
        """Let the window see a stored frame, if it has the time."""
        self._top.saw(frame)
        if not self._pace.due:
            return
        self._pace.begin()
        state = self._top.state(live=False, running=True)
        self._channel.send(state)
        seen = LiveFrame(
            image=frame.image,
            target=shot.target,
            pattern=shot.pattern,
            wavelength=state.wavelength,
            exposure=frame.exposure,
            number=frame.number,
        )
        self._effects.tell(seen)
        self._channel.send_frame(seen)
