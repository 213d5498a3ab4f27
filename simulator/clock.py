"""A clock that is as fast as the computer, or as fast as somebody wants to watch."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

_LOOK = 0.01
"""Seconds between looks at whether a wait was cancelled."""


class VirtualClock:
    """Time that moves only while somebody waits.

    speed: its seconds in a second of the wall's. Infinite by default: waiting takes no time.
    """

    def __init__(self, speed: float = math.inf) -> None:
        if not speed > 0:
            raise ValueError(f"speed is {speed:g}; it must be positive. 1 is real time")
        self._speed = speed
        self._time = 0.0
        self._lock = threading.Lock()

    def now(self) -> float:
        return self._time

    def wait_until(self, time_: float, cancelled: Callable[[], bool]) -> None:
        """Return at `time_`, or soon after `is_cancelled()` turns true."""
        started, at_start = time.monotonic(), self._time
        while self._time < time_ and not cancelled():
            left = (time_ - self._time) / self._speed
            if left > 0:
                time.sleep(min(left, _LOOK))
            passed = (time.monotonic() - started) * self._speed
            # Two who wait at once wait through the same time.
            self._reach(time_ if left == 0 else min(time_, at_start + passed))

    def _reach(self, time_: float) -> None:
        with self._lock:
            self._time = max(self._time, time_)
