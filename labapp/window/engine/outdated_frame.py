"""When a live frame is given up that nobody waits for any more."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from labapp.window.engine.channel import Channel
from labapp.window.engine.live_tolerance import LiveTolerance

if TYPE_CHECKING:
    from simulator.world import World

_LEAST_SECONDS = 0.2
"""Seconds that a frame may take in any case. Chosen: while a person turns a setting, short
exposures come to their end, and pictures go on."""


class OutdatedFrame:
    """Give up a frame that is being taken, because the window sent a command or a tolerance.

    Otherwise a command would wait for a long exposure, or for the simulation of a picture that
    nobody wants to see any more.
    world: that of a simulated camera, or None.
    """

    def __init__(self, channel: Channel, tolerance: LiveTolerance, world: World | None) -> None:
        self._channel, self._tolerance, self._world = channel, tolerance, world
        self._began = 0.0
        self._given_up = False

    @property
    def is_given_up(self) -> bool:
        """Return whether the last frame was given up."""
        return self._given_up

    @contextmanager
    def watch(self) -> Iterator[None]:
        """Watch for commands while a frame is taken in the block.

        A simulated camera looks between the steps of a picture. Cancelling it would not do, since
        it would count as hanging if a step took long.
        """
        self._began, self._given_up = time.monotonic(), False
        if self._world is None:
            yield
            return
        self._world.is_picture_unwanted = self._look
        try:
            yield
        finally:
            self._world.is_picture_unwanted = lambda: False

    def is_cancelled(self) -> bool:
        """Return whether the camera has to stop, as the window is gone or waits for another frame.

        Simulated exposures end by themselves in the second case, see `watch`.
        """
        return self._channel.closed or (self._world is None and self._look())

    def _look(self) -> bool:
        is_late = self._channel.has_commands and time.monotonic() - self._began > _LEAST_SECONDS
        self._given_up = self._given_up or is_late or self._tolerance.is_frame_given_up
        return self._given_up
