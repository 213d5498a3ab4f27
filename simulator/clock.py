"""A clock that is as fast as the computer."""

from __future__ import annotations

from collections.abc import Callable


class VirtualClock:
    """Waiting takes no time; the clock's own time moves as if it did."""

    def __init__(self) -> None:
        self._time = 0.0

    def now(self) -> float:
        return self._time

    def wait_until(self, time: float, cancelled: Callable[[], bool]) -> None:
        if not cancelled():
            self._time = max(self._time, time)
