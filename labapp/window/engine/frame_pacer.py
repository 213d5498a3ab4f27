"""How often the window gets a picture."""

from __future__ import annotations

import time

from labapp.window.engine.channel import Channel

_INTERVAL = 1 / 30
"""Seconds from picture to picture at the least: the eye sees no more, and the CPU is shared."""


class FramePacer:
    """When the next picture is due; never while the window has not taken in the last."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._last = 0.0

    @property
    def seconds_left(self) -> float:
        return max(0.0, self._last + _INTERVAL - time.monotonic())

    @property
    def is_due(self) -> bool:
        return self._channel.has_room and self.seconds_left == 0

    def begin(self) -> None:
        """A picture is being taken now."""
        self._last = time.monotonic()
