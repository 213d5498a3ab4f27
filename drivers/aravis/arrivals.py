"""Frames of one stream as they arrive: which is the next one, and when it left the camera."""

from __future__ import annotations

from typing import Any

_MAX_CLOCK_DRIFT = 1e-4
"""By which part a camera's clock may be slow."""


class BadFrame(Exception):
    """A frame that can't be taken. kind: the name it is counted under."""

    def __init__(self, kind: str, words: str) -> None:
        super().__init__(words)
        self.kind = kind


class FrameArrivals:
    """Of a stream that has just begun. A note: what the library tells of a frame."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._clock_offset: tuple[float, float] | None = None

    def is_fresh(self, note: dict[str, Any], since: float) -> bool:
        """Whether it is the one that was triggered: no other has come from this stream."""
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
        """How many frames never arrived before this one, by their numbers."""
        number, last = note["number"], self._last
        self._last = number
        if last is None or follows(number, last):
            return 0
        around = 65535 if last < 65536 and number < last else 0
        return max(1, number + around - last - 1)

    def departure_time(self, note: dict[str, Any]) -> float:
        """When a frame left the camera, by both clocks: a busy computer notices it later.

        The camera's clock counts from anywhere; the least that one was ever behind the other
        is what lies between them, but for what they drift apart.
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
    """GigE Vision counts to 65535 and then from 1, or in 64 bits; USB3 Vision from 0."""
    return number == last + 1 or (last == 65535 and number in (0, 1))
