"""Which frames of a stream are of the exposure that is set, and of now."""

from __future__ import annotations

import time
from dataclasses import dataclass

from drivers.uvc.stream import QUEUE_LENGTH, Stream, StreamFrame

_MIN_INTERVAL_RATIO = 0.7
"""Of an exposure that the time between two frames must be, at least."""


@dataclass(frozen=True)
class ExposureInForce:
    """An exposure in seconds, its number in the camera's units, and since when it is set.

    previous_exposure: the exposure before it. set_at: by time.monotonic(); what was begun earlier
    may have been exposed for either time.
    """

    units: int = 0
    exposure: float = 0.0
    previous_exposure: float = 0.0
    set_at: float = 0.0

    def with_exposure(self, units: int, exposure: float) -> ExposureInForce:
        """Another exposure, which is set from now on."""
        return ExposureInForce(units, exposure, self.exposure, time.monotonic())

    def is_in_frame(self, stream: Stream, shot: StreamFrame, discard_frames: int) -> bool:
        """Whether more than `discard_frames` frames were begun since it was set, up to this one.

        A frame's time is that of its end at the latest, so it was begun an exposure and a
        frame's time before at the earliest. One without a time of its own may have waited in
        the system's queue.
        """
        margin = self._frame_time(stream) + max(self.previous_exposure, self.exposure)
        most = discard_frames + (0 if shot.stamped else QUEUE_LENGTH)
        return stream.count_frames_since(self.set_at + margin, shot.number) > most

    def is_begun_after(self, time_: float, stream: Stream, shot: StreamFrame) -> bool:
        """Whether a frame must have been begun after `time_`."""
        margin = self._frame_time(stream) + self.exposure
        return stream.count_frames_since(time_ + margin, shot.number) > (
            0 if shot.stamped else QUEUE_LENGTH
        )

    def too_short_interval(self, stream: Stream, shot: StreamFrame) -> float:
        """The time between frames, if that is too short for the exposure; else 0."""
        gap = stream.interval_before(shot.number)
        return gap if shot.stamped and gap < _MIN_INTERVAL_RATIO * self.exposure else 0.0

    def _frame_time(self, stream: Stream) -> float:
        return max(stream.period, self.exposure)
