"""The clock of real devices."""

from __future__ import annotations

import time
from collections.abc import Callable

_PATIENCE = 0.02
"""Seconds between looks at whether the wait was cancelled."""


class RealClock:
    """Seconds since the clock was made."""

    def __init__(self) -> None:
        self._start = time.monotonic()

    def now(self) -> float:
        return time.monotonic() - self._start

    def wait_until(self, time_: float, cancelled: Callable[[], bool]) -> None:
        while (left := time_ - self.now()) > 0 and not cancelled():
            time.sleep(min(left, _PATIENCE))
