"""How long a run takes: what has passed, and what is left at its own pace."""

from __future__ import annotations

import time


class Timing:
    """Real seconds of one run.

    expected: seconds of bench time of its frames. A virtual bench's pass faster, and a real
    one may be late, so what is left is told from the frames that have been taken.
    """

    def __init__(self, expected: float) -> None:
        self.expected = expected
        self._began: float | None = None
        self._ended: float | None = None
        self._frame_began: float | None = None
        self._done = self._counted = self._worked = 0.0

    def begin(self) -> None:
        self._began = time.monotonic()

    def end(self) -> None:
        self._ended = time.monotonic()

    def rest(self) -> None:
        """Nothing is taken for a while, which says nothing about the pace."""
        self._frame_began = None

    def frame(self, lasts: float) -> None:
        """A frame of `lasts` seconds of bench time is on the disk."""
        now = time.monotonic()
        # Before the first frame patterns were computed, and in a rest nothing was done.
        if self._frame_began is not None:
            self._worked += now - self._frame_began
            self._counted += lasts
        self._frame_began = now
        self._done += lasts

    @property
    def elapsed(self) -> float:
        if self._began is None:
            return 0.0
        return (time.monotonic() if self._ended is None else self._ended) - self._began

    @property
    def left(self) -> float | None:
        """None while nobody can tell."""
        if not self._counted:
            return None
        began = self._frame_began
        under_way = 0.0 if began is None else time.monotonic() - began
        pace = self._worked / self._counted
        return max(0.0, (self.expected - self._done) * pace - under_way)
