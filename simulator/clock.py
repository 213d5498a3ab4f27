"""The virtual bench's clock, which can run faster than real time."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable


class VirtualClock:
    """A clock whose time advances only while a caller waits.

    speed: seconds of virtual time per second of real time; infinite, waiting takes no time.
    """

    def __init__(self, speed: float = math.inf) -> None:
        if not speed > 0:
            raise ValueError(f"speed is {speed:g}; it must be positive. 1 is real time")
        self._speed, self._time = speed, 0.0
        self._lock = threading.Lock()

    def now(self) -> float:
        """Return the virtual time in seconds."""
        return self._time

    def wait_until(self, time_: float, cancelled: Callable[[], bool]) -> None:
        """Wait until the virtual time is `time_`, or soon after `cancelled()` turns true."""
        started, at_start = time.monotonic(), self._time
        while self._time < time_ and not cancelled():
            left = (time_ - self._time) / self._speed
            if left > 0:
                # Sleep at most 10 ms at a time, to notice a cancellation.
                time.sleep(min(left, 0.01))
            passed = (time.monotonic() - started) * self._speed
            # Two threads that wait at once share the elapsed time; it isn't added up.
            reached = time_ if left == 0 else min(time_, at_start + passed)
            with self._lock:
                self._time = max(self._time, reached)
