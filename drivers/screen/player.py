"""Choose the video frame for each refresh, and record when it was shown."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MAX_HISTORY = 1 << 16
"""Presentations whose times are kept: 18 minutes at 60 Hz. All are counted."""


@dataclass(frozen=True)
class Presentations:
    """Which frames of a video were shown since it began, and when.

    Parameters
    ----------
    frames : ndarray of int64, shape (n,)
        Indices into the video in the order in which they were shown; the last 65536 at most.
    times : ndarray of float64, shape (n,)
        When each was shown, in seconds of the bench's clock.
    count : int
        Number of all frames that were shown.
    missed : int
        Number of refreshes that showed the frame before once more, plus the frames that were
        replaced before any refresh showed them. The video itself never skips a frame.
    """

    frames: NDArray[np.int64]
    times: NDArray[np.float64]
    count: int
    missed: int


class VideoPlayer:
    """Draw the next frame at each refresh, and record the presentations.

    draw: draws the frame with an index, and returns when the X server has received it. now:
    returns the time in the clock of the refreshes.
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
        """Draw the next frame after the refresh `number`.

        Returns the number of the refresh that will show the frame.
        """
        index = self._presented % self._count
        self._draw(index)
        # The frame appears at the first refresh after it was drawn.
        later = max(1, math.ceil((self._now() - time) / self._period))
        self._record_presentation(index, time + later * self._period)
        return number + later

    def _record_presentation(self, index: int, time: float) -> None:
        if self._shown:
            # Refreshes are counted by time, because the server's count stops while the screen is
            # dark. The time is smoothed, because a busy server without a real screen reports some
            # refreshes late, which would otherwise be counted as missed or doubled.
            steps = round((time - self._smoothed_time) / self._period)
            self._missed += abs(steps - 1)
            self._smoothed_time += steps * self._period
            # The smoothed time follows the reported one by a twentieth, because the period in the
            # computer's clock differs slightly from the screen's.
            self._smoothed_time += 0.05 * (time - self._smoothed_time)
        else:
            self._smoothed_time = time
        self._shown.append((index, time))
        self._presented += 1

    def presentations(self) -> Presentations:
        """Return the frames that were shown; an overdue one counts as missed."""
        overdue = 0
        if self._shown:
            late = (self._now() - self._shown[-1][1]) / self._period
            overdue = max(0, math.floor(late - 0.5))
        frames = np.array([index for index, _ in self._shown], np.int64)
        times = np.array([time for _, time in self._shown], float)
        return Presentations(frames, times, self._presented, self._missed + overdue)
