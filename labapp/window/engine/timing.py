"""How long a run takes: what has passed, and what is left as it goes."""

from __future__ import annotations

import time


class RunTiming:
    """Real seconds of one run.

    expected_bench_seconds: of its frames, in the bench's time. virtual: whether the bench's clock
    takes no real time. What a frame takes beyond that (computing, disks, trouble) is told from
    those that have been taken.
    """

    def __init__(self, expected: float, frames: int, *, virtual: bool) -> None:
        self.expected_bench_seconds = expected
        self._rate = 0.0 if virtual else 1.0
        self._frames_left, self._bench_seconds_left = frames, expected
        self._began: float | None = None
        self._ended: float | None = None
        self._frame_began: float | None = None
        self._counted, self._beyond = 0, 0.0

    def begin(self) -> None:
        self._began = time.monotonic()

    def end(self) -> None:
        self._ended = time.monotonic()

    def rest(self) -> None:
        """Nothing is taken for a while, which says nothing about the frames to come."""
        self._frame_began = None

    def count_frame(self, lasts: float) -> None:
        """A frame of `lasts` seconds of bench time is on the disk."""
        now = time.monotonic()
        # Before the first frame patterns were computed, and in a rest nothing was done.
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
        """None while nobody can tell."""
        if not self._counted:
            return self._bench_seconds_left if self._rate else None
        began = self._frame_began
        under_way = 0.0 if began is None else time.monotonic() - began
        beyond = max(0.0, self._beyond / self._counted)
        left = self._rate * self._bench_seconds_left + beyond * self._frames_left
        return max(0.0, left - under_way)
