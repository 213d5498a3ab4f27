"""Decide which frames of a stream have the current exposure and are recent."""

from __future__ import annotations

import time
from dataclasses import dataclass

from drivers.uvc.stream import QUEUE_LENGTH, Stream, StreamFrame


@dataclass(frozen=True)
class ExposureInForce:
    """The exposure in seconds and in the camera's own units, and when it was set.

    previous_exposure: the exposure before it. set_at: time.monotonic() of the change; frames that
    began earlier may have either exposure.
    """

    units: int = 0
    exposure: float = 0.0
    previous_exposure: float = 0.0
    set_at: float = 0.0

    def with_exposure(self, units: int, exposure: float) -> ExposureInForce:
        """Return the state after a new exposure came in force now."""
        return ExposureInForce(units, exposure, self.exposure, time.monotonic())

    def is_in_frame(self, stream: Stream, shot: StreamFrame, discard_frames: int) -> bool:
        """Return whether a frame certainly has this exposure.

        More than `discard_frames` frames must have begun since it was set, including this one. A
        frame's time stamp is at its end at the latest. It began at most an exposure and a frame
        time before that. A frame without the camera's time stamp may also have waited in the
        system's queue.
        """
        margin = self._frame_time(stream) + max(self.previous_exposure, self.exposure)
        most = discard_frames + (0 if shot.stamped else QUEUE_LENGTH)
        return stream.count_frames_since(self.set_at + margin, shot.number) > most

    def is_begun_after(self, time_: float, stream: Stream, shot: StreamFrame) -> bool:
        """Return whether a frame's exposure certainly began after `time_`."""
        margin = self._frame_time(stream) + self.exposure
        return stream.count_frames_since(time_ + margin, shot.number) > (
            0 if shot.stamped else QUEUE_LENGTH
        )

    def too_short_interval(self, stream: Stream, shot: StreamFrame) -> float:
        """Return the seconds since the frame before if clearly less than the exposure; else 0."""
        gap = stream.interval_before(shot.number)
        return gap if shot.stamped and gap < 0.7 * self.exposure else 0.0

    def _frame_time(self, stream: Stream) -> float:
        return max(stream.period, self.exposure)
