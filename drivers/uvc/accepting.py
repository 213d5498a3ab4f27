"""Which frames of a stream are of the exposure that is set, and of now."""

from __future__ import annotations

import time
from dataclasses import dataclass

from drivers.uvc.stream import QUEUED, Shot, Stream

_SHARE = 0.7
"""Of an exposure that the time between two frames must be, at least."""


@dataclass(frozen=True)
class InForce:
    """An exposure in seconds, its number in the camera's units, and since when it is set.

    before: the exposure before it. since: by time.monotonic(); what was begun earlier may have
    been exposed for either time.
    """

    units: int = 0
    exposure: float = 0.0
    before: float = 0.0
    since: float = 0.0

    def changed(self, units: int, exposure: float) -> InForce:
        """Another exposure, which is set from now on."""
        return InForce(units, exposure, self.exposure, time.monotonic())

    def shows(self, stream: Stream, shot: Shot, passing: int) -> bool:
        """Whether more than `passing` frames were begun since it was set, up to this one.

        A frame's time is that of its end at the latest, so it was begun an exposure and a
        frame's time before at the earliest. One without a time of its own may have waited in
        the system's queue.
        """
        margin = self._frame_time(stream) + max(self.before, self.exposure)
        most = passing + (0 if shot.stamped else QUEUED)
        return stream.since(self.since + margin, shot.number) > most

    def is_begun_after(self, time_: float, stream: Stream, shot: Shot) -> bool:
        """Whether a frame must have been begun after `time_`."""
        margin = self._frame_time(stream) + self.exposure
        return stream.since(time_ + margin, shot.number) > (0 if shot.stamped else QUEUED)

    def too_fast(self, stream: Stream, shot: Shot) -> float:
        """The time between frames, if that is too short for the exposure; else 0."""
        gap = stream.gap_before(shot.number)
        return gap if shot.stamped and gap < _SHARE * self.exposure else 0.0

    def _frame_time(self, stream: Stream) -> float:
        return max(stream.period, self.exposure)
