"""The engine's loop: one command, one live frame, and so on, until the window is gone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.runs.state import State
from labapp.window.engine.acquisition import Acquisition
from labapp.window.engine.background import Background, Computed
from labapp.window.engine.benchtop import Benchtop
from labapp.window.engine.channel import Channel
from labapp.window.engine.effects import Effects
from labapp.window.engine.failures import failure
from labapp.window.engine.herald import Herald
from labapp.window.engine.jobs import Jobs
from labapp.window.engine.pace import Pace
from labapp.window.engine.person import Person
from labapp.window.engine.planner import Planner
from labapp.window.engine.run import Run
from labapp.window.engine.run_queue import RunQueue
from labapp.window.messages import (
    Acquire,
    Answer,
    Cancel,
    CancelHeard,
    ClearRuns,
    Expose,
    GoOn,
    PauseRun,
    Place,
    Preview,
    QueueState,
    Reconnect,
    Reconnected,
    Reconstruct,
    RemoveRuns,
    ResumeRun,
    RunPlan,
    SaveRestored,
    SetLive,
    Show,
    Tune,
)

_PATIENCE = 0.1
"""Seconds to wait for a command when there is no picture to take."""


class RunsWait:
    """The engine's word to itself that a run may begin."""


class Engine:
    """Owns the bench, in the main thread; only this loop and runs move anything on it.

    Commands that must be heard during a run are obeyed at once, in the channel's thread.
    """

    def __init__(self, bench: Bench, channel: Channel) -> None:
        self._channel = channel
        herald = Herald(self._tell_queue)
        self._person = Person(herald.changed)
        self._queue = RunQueue(herald.changed)
        self._planner = Planner(
            bench, self._queue, failed=self._complain, ready=lambda: channel.post(RunsWait())
        )
        self._top = Benchtop(bench)
        self._jobs = Jobs(channel)
        self._pace = Pace(channel)
        self._background = Background(bench.description, channel, self._jobs, self._top)
        self._effects = Effects(bench, channel)
        self._acquisition = Acquisition(channel, self._top, self._pace, self._person, self._effects)
        self._live = self._live_again = False
        self._obey: dict[type, Callable[[Any], None]] = {
            SetLive: self._set_live,
            Place: lambda command: self._top.place(command.target),
            Tune: lambda command: self._top.tune(command.wavelength),
            Expose: lambda command: self._top.expose(command.exposure),
            Computed: lambda command: self._top.show(command.name, command.grey),
            Show: self._background.show,
            Reconnect: self._reconnect,
            RunsWait: self._run_all,
        }
        at_once: dict[type, Callable[[Any], None]] = {
            Preview: self._background.preview,
            Reconstruct: self._background.reconstruct,
            SaveRestored: self._background.save_restored,
            Acquire: self._planner.line_up,
            RunPlan: self._planner.line_up,
            ResumeRun: self._planner.line_up,
            RemoveRuns: lambda command: self._queue.remove(command.numbers),
            ClearRuns: lambda _: self._queue.clear(),
            GoOn: self._go_on,
            PauseRun: lambda command: self._queue.pause(command.on),
            Answer: lambda command: self._person.answer(command.number),
            Cancel: self._cancel,
        }
        channel.at_once = {kind: self._safely(obey) for kind, obey in at_once.items()}
        channel.on_end.append(self._stop)

    def run(self) -> None:
        """Until the window is gone. The bench is left safe by whoever opened it."""
        self._channel.send(self._top.opened())
        while not self._channel.closed:
            looking = self._live and self._channel.has_room
            command = self._channel.take(self._pace.seconds_left if looking else _PATIENCE)
            if command is not None:
                self._do(command)
            elif self._live and self._pace.due:
                self._take_frame()
        self._stop()
        self._planner.close()
        self._background.close()

    def _do(self, command: object) -> None:
        """Obey, say what went wrong, and say how the bench stands now."""
        try:
            self._obey[type(command)](command)
        except Exception as error:
            self._complain(error)
        self._tell()

    def _safely(self, obey: Callable[[Any], None]) -> Callable[[Any], None]:
        """The same for what is done at once: nothing may end the thread that hears Cancel."""

        def obeying(command: object) -> None:
            try:
                obey(command)
            except Exception as error:
                self._complain(error)

        return obeying

    def _complain(self, error: Exception) -> None:
        self._channel.send(failure(error, self._top))

    def _tell(self, *, running: bool = False) -> None:
        self._channel.send(self._top.state(self._live, running))

    def _tell_queue(self) -> None:
        queue = self._queue
        self._channel.send(QueueState(queue.infos(), queue.held, self._person.prompt))

    def _set_live(self, command: SetLive) -> None:
        if command.on and not self._live:
            self._top.restore()
        self._live = command.on

    def _take_frame(self) -> None:
        self._pace.begin()
        try:
            frame = self._top.frame(lambda: self._channel.closed)
            self._effects.tell(frame)
            self._channel.send_frame(frame)
        except Exception as error:
            self._live = False
            self._complain(error)
            self._tell()

    def _reconnect(self, command: Reconnect) -> None:
        self._top.reconnect(command.device)
        if self._live:
            self._top.restore()
        self._channel.send(Reconnected(command.device))

    def _cancel(self, command: Cancel) -> None:
        self._stop()
        self._channel.send(CancelHeard())

    def _stop(self) -> None:
        """End the work that is under way, beside the bench and on it."""
        self._jobs.cancel()
        self._queue.cancel()

    def _go_on(self, command: GoOn) -> None:
        self._queue.go_on()
        self._channel.post(RunsWait())

    def _run_all(self, command: RunsWait) -> None:
        """One run after the other. Live view stops for them, and comes back if it may."""
        while not self._channel.closed and (run := self._queue.begin()) is not None:
            self._live_again, self._live = self._live_again or self._live, False
            self._tell(running=True)
            may_move = self._take(run)
            if may_move and self._live_again and not self._queue.may_go_on:
                self._live_again = False
                self._top.restore()
                self._live = True

    def _take(self, run: Run) -> bool:
        """One run from its begin to its end; whether the bench may be moved after it."""
        try:
            ended = self._acquisition.take(run)
        except Exception as error:
            said = failure(error, self._top)
            self._queue.end(run, State.FAILED, said.message)
            self._channel.send(said)
            # The run couldn't begin, so nothing was moved.
            return isinstance(error, UserError | OSError)
        self._queue.end(run, ended.state, ended.message, ended.took)
        self._channel.send(ended)
        # After anything but success the bench stays safe until somebody says otherwise.
        return ended.path is None or ended.state is State.COMPLETE
