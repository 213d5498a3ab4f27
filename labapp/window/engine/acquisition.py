"""Acquisition of a queued run, whose frames are shown on the way."""

from __future__ import annotations

from collections.abc import Callable

from drivers.interfaces import Frame
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.shots import Shot
from labapp.runs.state import State
from labapp.window.engine.bench_controller import BenchController
from labapp.window.engine.channel import Channel
from labapp.window.engine.effects_reporter import EffectsReporter
from labapp.window.engine.frame_pacer import FramePacer
from labapp.window.engine.frame_sender import FrameSender
from labapp.window.engine.person_prompter import PersonPrompter
from labapp.window.engine.queued_run import QueuedRun
from labapp.window.engine.waiting_view import WaitingView
from labapp.window.messages import LiveFrame, RunEnded
from optics.progress import Cancelled, Progress


class Acquisition:
    """Take the frames of one queued run at a time; other threads may pause or cancel it."""

    def __init__(
        self,
        channel: Channel,
        top: BenchController,
        sender: FrameSender,
        pace: FramePacer,
        person: PersonPrompter,
        effects: EffectsReporter,
        waiting: WaitingView,
        on_frame: Callable[[LiveFrame], None],
    ) -> None:
        self._channel, self._controller, self._sender, self._pace = channel, top, sender, pace
        self._person, self._effects = person, effects
        self._waiting, self._on_frame = waiting, on_frame

    def take_run(self, run: QueuedRun) -> RunEnded:
        """Take a queued run; raises UserError, DeviceError or OSError if it couldn't begin."""
        run.on_pause, run.on_plug_change = self._tell, self._send_last_state

        def on_frame(shot: Shot, frame: Frame) -> None:
            run.count_stored_frame(shot, frame)
            self._show(shot, frame)

        def ask(text: str, progress: Progress) -> None:
            run.mark_paused(text)
            self._waiting.note_placing(True)
            try:
                self._person.ask(text, progress, self._waiting)
            finally:
                self._waiting.note_placing(False)
            run.mark_resumed()

        def judge(doubt: str, shot: Shot, frame: Frame, progress: Progress) -> bool:
            run.mark_paused(doubt)
            self._show(shot, frame, at_once=True)
            text = f"{doubt}. Put it right, then press Enter: the frame is taken again."
            kept = self._person.ask(
                text,
                progress,
                self._waiting,
                done="Take it again",
                alternative="Keep it as it is",
            )
            run.mark_resumed()
            return kept

        self._controller.devices.require_alive()
        try:
            # How many frames there are may be measured before the first.
            attendance = Attendance(
                run.progress, ask, judge, run.replan, on_frame, meanwhile=self._waiting
            )
            outcome = run.take(attendance)
        except Cancelled:
            return RunEnded(None, State.CANCELLED, 0, "cancelled before the first frame")
        if outcome.device_error is not None:
            self._controller.devices.mark_failed(outcome.device_error)
        missing, why = len(outcome.missing), outcome.message
        return RunEnded(outcome.path, outcome.state, missing, why, outcome.elapsed_seconds)

    def _tell(self) -> None:
        self._channel.send(self._controller.read_state(live=False, running=True))

    def _send_last_state(self) -> None:
        """Send the last known state, while the run is waiting for a device.

        No device is asked for its setting, since it could be the one that the run waits for.
        """
        self._channel.send(
            self._controller.read_state(live=False, running=True, query_devices=False)
        )

    def _show(self, shot: Shot, frame: Frame, *, at_once: bool = False) -> None:
        """Show a run's frame if the next frame is due, or at once."""
        self._controller.note_run_frame(frame)
        if not (self._pace.is_due or at_once):
            self._sender.skip(frame.number)
            return
        self._pace.begin()
        state = self._controller.read_state(live=False, running=True)
        self._channel.send(state)
        seen = LiveFrame(
            image=frame.image,
            target=shot.target,
            pattern=shot.pattern,
            wavelength=state.wavelength,
            exposure=frame.exposure,
            number=frame.number,
        )
        self._effects.report_if_changed(seen)
        self._sender.offer(seen, on_sent=self._on_frame)
