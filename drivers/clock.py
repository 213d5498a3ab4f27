"""Real time for devices, in seconds."""

from __future__ import annotations

import time
from collections.abc import Callable


class RealClock:
    """Seconds since this object was made, for a bench with real devices.

    start: start of another process's clock, in seconds of time.monotonic(). That time is the same
    in all processes, so both clocks then show the same time.
    """

    def __init__(self, start: float | None = None) -> None:
        self.start = time.monotonic() if start is None else start

    def now(self) -> float:
        return time.monotonic() - self.start

    def wait_until(self, time_: float, cancelled: Callable[[], bool]) -> None:
        while (left := time_ - self.now()) > 0 and not cancelled():
            # Every 20 ms the clock checks whether the wait was cancelled.
            time.sleep(min(left, 0.02))
