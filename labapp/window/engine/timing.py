"""Times of a run in the engine's queue: the time that has passed, and an estimate of the rest."""

from __future__ import annotations

import time


class RunTiming:
    """Measure the real seconds of one queued run, and estimate those that are left.

    `expected_bench_seconds` is the time of its frames on the bench's clock. `virtual` tells
    whether that clock takes no real time. The further time of a frame (computing, disks, failures)
    is estimated from the frames taken so far.
    """

    def __init__(self, expected: float, frames: int, *, virtual: bool) -> None:
        self.expected_bench_seconds = expected
        self._rate = 0.0 if virtual else 1.0
        self._frames_left, self._bench_seconds_left = frames, expected
        self._began: float | None = None
        self._ended: float | None = None
        self._frame_began: float | None = None
        self._counted, self._beyond = 0, 0.0

    def replan(self, expected: float, frames: int) -> None:
        """Take over the bench time and number of a queued run's frames, before the first one."""
        self.expected_bench_seconds = self._bench_seconds_left = expected
        self._frames_left = frames

    def begin(self) -> None:
        self._began = time.monotonic()

    def end(self) -> None:
        self._ended = time.monotonic()

    def rest(self) -> None:
        """Note a pause of a run in the window's queue, which must not count as frame time."""
        self._frame_began = None

    def count_frame(self, lasts: float) -> None:
        """Count a stored frame of a run in the window's queue.

        `lasts` is the frame's time in seconds on the bench's clock.
        """
        now = time.monotonic()
        # The time before the first frame (computing patterns) and pauses don't count.
        if self._frame_began is not None:
            self._beyond += now - self._frame_began - self._rate * lasts
            self._counted += 1
        self._frame_began = now
        self._frames_left -= 1
        self._bench_seconds_left -= lasts

    @property
    def elapsed_seconds(self) -> float:
        if self._began is None:
            return 0.0
        return (time.monotonic() if self._ended is None else self._ended) - self._began

    @property
    def seconds_left(self) -> float | None:
        """Return the real seconds that a queued run in the window still needs; None if unknown."""
        if not self._counted:
            return self._bench_seconds_left if self._rate else None
        began = self._frame_began
        under_way = 0.0 if began is None else time.monotonic() - began
        beyond = max(0.0, self._beyond / self._counted)
        left = self._rate * self._bench_seconds_left + beyond * self._frames_left
        return max(0.0, left - under_way)
