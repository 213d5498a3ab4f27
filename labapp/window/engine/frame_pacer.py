"""The rate at which the engine sends frames to the window."""

from __future__ import annotations

import time

from labapp.window.engine.channel import Channel

_INTERVAL = 1 / 30
"""Least seconds between frames for the window: the eye sees no more, and frames need the CPU."""


class FramePacer:
    """Tell when the next frame for the window is due; never while the window has no room for it."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._last = 0.0

    @property
    def seconds_left(self) -> float:
        return max(0.0, self._last + _INTERVAL - time.monotonic())

    @property
    def is_due(self) -> bool:
        """Return whether the window's next live frame is due."""
        return self._channel.has_room and self.seconds_left == 0

    def begin(self) -> None:
        """Note that a frame for the window is being taken now."""
        self._last = time.monotonic()
