"""Check the order of a stream's frames, and estimate when each left the camera."""

from __future__ import annotations

from typing import Any

_MAX_CLOCK_DRIFT = 1e-4
"""Relative rate by which a camera's clock may be slow; chosen."""

_WRONG_CLOCK = (2e-3, 2e-3)
"""Share of the time and seconds by which a camera's clock and this computer's may differ. Chosen:
quartzes differ by 1e-4."""

_LONGEST_DELAY = 2.0
"""Seconds by which a busy computer may notice a free-running camera's frame late. Chosen."""


class BadFrame(Exception):
    """A frame that is rejected.

    kind: the name under which it is counted. remedy: what to do if other frames will be alike, so
    that none is worth another try.
    """

    def __init__(self, kind: str, words: str, remedy: str = "") -> None:
        super().__init__(words)
        self.kind, self.remedy = kind, remedy


class FrameArrivals:
    """Track the frames of a stream that has just begun.

    Its methods take a note: what the library reports about one frame.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._clock_offset: tuple[float, float] | None = None
        self._first: tuple[float, float, int] | None = None
        self._last_stamp = 0

    def require_right_clock(self, note: dict[str, Any], triggered_at: float | None) -> None:
        """Raise BadFrame if the camera's clock stands still, goes back or goes wrong.

        A frame is stamped between its trigger and its arrival, which may be noticed late. A camera
        whose stamps are all zero has no clock. triggered_at: time.monotonic(); None if the camera
        runs freely.
        """
        stamp, last, arrived = note["stamp"], self._last_stamp, note["arrived"]
        began = arrived - _LONGEST_DELAY if triggered_at is None else triggered_at
        self._last_stamp = stamp
        if not last:
            self._first = began, arrived, stamp
            return
        assert self._first is not None
        first_began, first_arrived, first_stamp = self._first
        told, (share, seconds) = (stamp - first_stamp) * 1e-9, _WRONG_CLOCK
        least = (began - first_arrived) * (1 - share) - seconds
        most = (arrived - first_began) * (1 + share) + seconds
        if stamp <= last:
            words = "stands still" if stamp == last else "went back"
        elif not least <= told <= most:
            words = f"counted {told:.3f} s in {max(least, 0):.3f} to {most:.3f} s"
        else:
            return
        remedy = "Restart the camera. If it stays, ask its maker"
        raise BadFrame("wrong clock", f"the camera's clock {words}", remedy)

    def is_fresh(self, note: dict[str, Any], since: float) -> bool:
        """Return whether a frame is the triggered one, not an older or repeated one.

        BadFrame if its number is out of order.
        """
        number, last = note["number"], self._last
        if note["arrived"] < since - 1e-3:
            return False
        if last is not None and not follows(number, last):
            if number == last:
                return False
            raise BadFrame("out of order", f"number {number} after {last}")
        self._last = number
        return True

    def frames_lost_before(self, note: dict[str, Any]) -> int:
        """Count, by the numbers, the frames that were lost just before this one."""
        number, last = note["number"], self._last
        self._last = number
        if last is None or follows(number, last):
            return 0
        around = 65535 if last < 65536 and number < last else 0
        return max(1, number + around - last - 1)

    def departure_time(self, note: dict[str, Any]) -> float:
        """Estimate the time.monotonic() at which a frame left the camera.

        A busy computer notices a frame late, so the camera's own time stamp is used, too. The
        camera's clock has an arbitrary zero. The smallest difference seen so far between arrival
        and stamp is taken as the offset between the clocks, with an allowance for their drift.
        """
        arrived: float = note["arrived"]
        if not note["stamp"]:
            return arrived
        stamp = note["stamp"] * 1e-9
        between = arrived - stamp
        if self._clock_offset is not None:
            least, when = self._clock_offset
            between = min(between, least + _MAX_CLOCK_DRIFT * max(0.0, arrived - when))
        self._clock_offset = between, arrived
        return stamp + between


def follows(number: int, last: int) -> bool:
    """Return whether a frame number directly follows `last`.

    GigE Vision counts to 65535 and continues from 1, or counts in 64 bits; USB3 Vision begins
    at 0.
    """
    return number == last + 1 or (last == 65535 and number in (0, 1))
