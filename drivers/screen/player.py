"""Frames of a video, one at each refresh of the screen, and when each was really presented."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MAX_HISTORY = 1 << 16
"""Presentations whose times are kept: 18 minutes at 60 Hz. All are counted."""

_TRACKING_GAIN = 0.05
"""Share of a refresh's delay by which the even times follow it: no clock is the screen's."""


@dataclass(frozen=True)
class Presentations:
    """What was presented of a video since it began.

    frames: indices into the video, in the order in which they were presented; times: when,
    in seconds of the bench's clock. Both are of the last 65536 at most. count: of all.
    missed: refreshes at which a frame should have come and didn't, because the one before
    it still stood, and frames that came so soon that no refresh showed the one before. No
    frame is ever left out.
    """

    frames: NDArray[np.int64]
    times: NDArray[np.float64]
    count: int
    missed: int


class VideoPlayer:
    """Says which frame is to be drawn at a refresh, and keeps account.

    draw: draws the frame of an index, and returns when the server has it. now: the time that
    refreshes are told in.
    """

    def __init__(
        self, frames: int, period: float, draw: Callable[[int], None], now: Callable[[], float]
    ) -> None:
        self._count, self._period = frames, period
        self._draw, self._now = draw, now
        self._shown: deque[tuple[int, float]] = deque(maxlen=_MAX_HISTORY)
        self._presented = self._missed = 0
        self._smoothed_time = 0.0

    def on_refresh(self, number: int, time: float) -> int:
        """Refresh `number` was at `time`: draw the next frame. The refresh that shows it."""
        index = self._presented % self._count
        self._draw(index)
        # Drawn after that refresh, it is seen from the next one on that is still to come.
        later = max(1, math.ceil((self._now() - time) / self._period))
        self._record_presentation(index, time + later * self._period)
        return number + later

    def _record_presentation(self, index: int, time: float) -> None:
        if self._shown:
            # By time and not by the server's count, which stands still for a dark screen. And
            # by even times: a busy server that makes refreshes up tells some of them late,
            # and from each to the next one would now be lost, now be counted twice.
            steps = round((time - self._smoothed_time) / self._period)
            self._missed += abs(steps - 1)
            self._smoothed_time += steps * self._period
            self._smoothed_time += _TRACKING_GAIN * (time - self._smoothed_time)
        else:
            self._smoothed_time = time
        self._shown.append((index, time))
        self._presented += 1

    def presentations(self) -> Presentations:
        """Until now; a frame that is overdue is counted as missed."""
        overdue = 0
        if self._shown:
            late = (self._now() - self._shown[-1][1]) / self._period
            overdue = max(0, math.floor(late - 0.5))
        frames = np.array([index for index, _ in self._shown], np.int64)
        times = np.array([time for _, time in self._shown], float)
        return Presentations(frames, times, self._presented, self._missed + overdue)
