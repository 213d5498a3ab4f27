"""Live pictures while a run waits: a person who places a target sees it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

from drivers.errors import DeviceError
from labapp.bench.opening import Bench
from labapp.window.commands import SetExposure, SetLive
from labapp.window.engine.bench_controller import BenchController
from labapp.window.engine.channel import Channel
from labapp.window.engine.frame_pacer import FramePacer
from labapp.window.engine.frame_sender import FrameSender
from labapp.window.messages import LiveFrame

_INTERVAL = 0.05
"""Most seconds until a wait looks again whether it is over. Chosen: no delay is felt."""

_LONG = 0.5
"""Exposure in seconds from which on a picture is given up when the wait is over. Chosen: a shorter
one is over before a person minds."""


_BEING_PLACED = "being placed"
"""What the caption says of a target that a person is asked to place."""


class WaitingView:
    """Take live pictures while a run waits for a person.

    All of it happens in the run's thread, between its frames: a picture is shown, measured if that
    is asked for, and never stored. Of the settings, only the exposure can be changed; the run sets
    it for every frame, and it is set back besides. F5 ends and begins the pictures.

    allowed: further commands that are carried out meanwhile.
    on_frame: is given each picture.
    complain: tells the window of an error.
    """

    def __init__(
        self,
        bench: Bench,
        channel: Channel,
        sender: FrameSender,
        controller: BenchController,
        pace: FramePacer,
        allowed: Mapping[type, Callable[[Any], None]],
        on_frame: Callable[[LiveFrame], None],
        complain: Callable[[Exception], None],
    ) -> None:
        self._bench, self._channel, self._sender = bench, channel, sender
        self._controller, self._pace = controller, pace
        self._on_frame, self._complain = on_frame, complain
        self._obey: dict[type, Callable[[Any], None]] = {
            SetLive: self._set_live,
            SetExposure: lambda command: controller.set_exposure(command.exposure),
            **allowed,
        }
        self._on = self._placing = False
        self._is_over: Callable[[], bool] = lambda: False
        self._exposure = 0.0

    @property
    def is_over(self) -> bool:
        """Return whether commands are to end, since a run that waited goes on."""
        return self._is_over()

    def note_placing(self, on: bool) -> None:
        """Note whether a person is placing a target just now, so that no name is known of it."""
        self._placing = on and self._bench.targets.by_hand

    def begin(self) -> None:
        """Begin live pictures, at the settings that the run left."""
        self._on, self._exposure = True, self._controller.exposure
        if self._bench.camera_world is not None:
            # No planned frame has this index, so that faults of planned frames don't strike.
            self._bench.camera_world.begin_frame(0, 0, 0, index=-1)
        self._tell()

    def step(self, is_over: Callable[[], bool]) -> None:
        """Carry out a command, or take a live picture."""
        self._is_over = is_over
        seconds = self._pace.seconds_left if self._on and self._sender.has_room else _INTERVAL
        command = self._channel.take_command_of(self._obey, min(seconds, _INTERVAL))
        if command is not None:
            self._do(command)
        elif self._on and self._pace.is_due and not is_over():
            self._take_frame(is_over)
        elif self._channel.closed:
            time.sleep(_INTERVAL)

    def end(self) -> None:
        """End the live pictures, and set the exposure that the run had set."""
        self._on, self._is_over = False, lambda: False
        if self._controller.exposure != self._exposure:
            with suppress(DeviceError):
                self._controller.try_exposure(self._exposure)
        self._tell(waiting=False)

    def _do(self, command: object) -> None:
        try:
            self._obey[type(command)](command)
        except Exception as error:
            self._complain(error)
        self._tell()

    def _set_live(self, command: SetLive) -> None:
        """Begin or end the pictures; none of before comes to the window after this."""
        if command.on != self._on:
            self._sender.discard()
        self._on = command.on

    def _take_frame(self, is_over: Callable[[], bool]) -> None:
        """Take a live picture; an error ends the pictures, and not the run."""
        self._pace.begin()
        # A simulated exposure takes no time, and a computation that is cancelled may seem to hang.
        may_give_up = self._bench.file.is_real and self._controller.exposure > _LONG
        try:
            with self._controller.live_tolerance.during_frame():
                frame = self._controller.take_frame(
                    lambda: self._channel.closed or (may_give_up and is_over())
                )
        except Exception as error:
            tolerance = self._controller.live_tolerance
            if not (is_over() or tolerance.is_frame_given_up):
                self._on = False
                self._complain(error)
                self._tell()
            return
        if self._placing:
            frame = replace(frame, target=_BEING_PLACED)
        self._sender.offer(frame, on_sent=self._on_frame)

    def _tell(self, *, waiting: bool = True) -> None:
        state = self._controller.read_state(self._on, running=True)
        self._channel.send(replace(state, waiting=waiting))
