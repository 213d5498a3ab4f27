"""The clock of real devices."""

from __future__ import annotations

import time
from collections.abc import Callable

_POLL_INTERVAL = 0.02
"""Seconds between looks at whether the wait was cancelled."""


class RealClock:
    """Seconds since the clock was made.

    start: of another process's clock, in seconds of time.monotonic(), which is the same in
    all processes: both clocks then show the same time.
    """

    def __init__(self, start: float | None = None) -> None:
        self.start = time.monotonic() if start is None else start

    def now(self) -> float:
        return time.monotonic() - self.start

    def wait_until(self, time_: float, cancelled: Callable[[], bool]) -> None:
        while (left := time_ - self.now()) > 0 and not cancelled():
            time.sleep(min(left, _POLL_INTERVAL))
