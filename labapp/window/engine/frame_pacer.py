"""The rate at which frames are taken for the screen."""

from __future__ import annotations

import time

from labapp.window.engine.frame_sender import FrameSender

_USUAL_INTERVAL = 1 / 60
"""Seconds between redraws of most screens, until the window says how often its own is redrawn."""


class FramePacer:
    """Tell when the next frame is due: as often as the window's screen is redrawn.

    No frame is due while another one waits for the window.
    """

    def __init__(self, sender: FrameSender) -> None:
        self._sender = sender
        self._next = 0.0
        self.interval = _USUAL_INTERVAL

    @property
    def seconds_left(self) -> float:
        return max(0.0, self._next - time.monotonic())

    @property
    def is_due(self) -> bool:
        return self._sender.has_room and self.seconds_left == 0

    def begin(self) -> None:
        """Note that a frame is being taken now; one somewhat late doesn't delay the next."""
        now = time.monotonic()
        self._next = max(self._next + self.interval, now)
