"""How often frames come to the screen, and how long none has come."""

from __future__ import annotations

from collections import deque

_SPAN = 1.0
"""Seconds over which the rate is averaged. Chosen."""

_SILENCE = 1.0
"""Seconds without a frame after which their age is said in the place of a rate. Chosen."""

_MOST_FRAMES = 240
"""Most frames that are remembered: those of a second, even on a fast screen. Chosen."""


class FrameRate:
    """Count live frames, and describe their rate, which ages when none comes."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=_MOST_FRAMES)

    def count(self, now: float) -> None:
        """Count a frame that is on the screen at a time in seconds."""
        self._arrivals.append(now)

    def describe(self, now: float) -> str:
        """Return the rate of frames at a time in seconds, or their age."""
        if not self._arrivals:
            return ""
        age = now - self._arrivals[-1]
        if age > _SILENCE:
            return f"no frame for {age:.0f} s"
        recent = [arrival for arrival in self._arrivals if now - arrival < _SPAN]
        span = now - recent[0] if recent else 0.0
        rate = (len(recent) - 1) / span if span > 0 else 0.0
        return f"{rate:4.1f} frames/s"
