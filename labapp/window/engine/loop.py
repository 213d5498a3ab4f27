"""The engine's loop: one command, one live frame, and so on, until the window is gone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from labapp.acquisition.state import State
from labapp.bench import Bench
from labapp.window.engine.acquisition import Acquisition
from labapp.window.engine.background import Background, Computed
from labapp.window.engine.benchtop import Benchtop
from labapp.window.engine.channel import Channel
from labapp.window.engine.failures import failure
from labapp.window.engine.jobs import Jobs
from labapp.window.engine.pace import Pace
from labapp.window.messages import (
    Acquire,
    Expose,
    Place,
    Preview,
    Reconstruct,
    SetLive,
    Show,
    Tune,
)

_PATIENCE = 0.1
"""Seconds to wait for a command when there is no picture to take."""


class Engine:
    """Owns the bench, in the main thread; only this loop and runs move anything on it."""

    def __init__(self, bench: Bench, channel: Channel) -> None:
        self._channel = channel
        self._top = Benchtop(bench)
        self._jobs = Jobs(channel)
        self._pace = Pace(channel)
        self._background = Background(bench.description, channel, self._jobs, self._top)
        self._acquisition = Acquisition(bench, channel, self._jobs, self._top, self._pace)
        self._live = False
        self._obey: dict[type, Callable[[Any], None]] = {
            SetLive: self._set_live,
            Place: lambda command: self._top.place(command.target),
            Tune: lambda command: self._top.tune(command.wavelength),
            Expose: lambda command: self._top.expose(command.exposure),
            Computed: lambda command: self._top.show(command.name, command.grey),
            Preview: self._background.preview,
            Show: self._background.show,
            Reconstruct: self._background.reconstruct,
            Acquire: self._acquire,
        }
        channel.on_cancel = self._jobs.cancel

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
        self._jobs.cancel()
        self._background.close()

    def _do(self, command: object) -> None:
        """Obey, say what went wrong, and say how the bench stands now."""
        try:
            self._obey[type(command)](command)
            self._top.absolve()
        except Exception as error:
            self._channel.send(failure(error, self._top))
        self._tell()

    def _tell(self, *, running: bool = False) -> None:
        self._channel.send(self._top.state(self._live, running))

    def _set_live(self, command: SetLive) -> None:
        if command.on and not self._live:
            self._top.restore()
        self._live = command.on

    def _take_frame(self) -> None:
        self._pace.begin()
        try:
            self._channel.send_frame(self._top.frame(lambda: self._channel.closed))
        except Exception as error:
            self._live = False
            self._channel.send(failure(error, self._top))
            self._tell()

    def _acquire(self, command: Acquire) -> None:
        """Live view stops for the run, and starts again if nothing speaks against it."""
        was_live, self._live = self._live, False
        self._tell(running=True)
        try:
            ended = self._acquisition.run(command)
        except Exception:
            # The run couldn't begin, so nothing was moved.
            self._live = was_live
            raise
        self._channel.send(ended)
        if ended.path is None:
            self._live = was_live
        elif was_live and ended.state == State.COMPLETE:
            # After anything but success the bench stays safe until somebody says otherwise.
            self._top.restore()
            self._live = True
