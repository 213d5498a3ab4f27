"""How many live frames a person doesn't get to see."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class FrameTally:
    """Count the frames that were taken but not shown, and those that never came.

    dropped: frames that were taken but not shown, because newer ones replaced them.
    missed: frames that the camera counted but didn't deliver: gaps in the frames' numbers.
    """

    dropped: int = 0
    missed: int = 0
    _last: int | None = None

    def count_taken(self, number: int) -> None:
        """Count a frame by the camera's number of it; a camera that begins anew misses none."""
        if self._last is not None and number > self._last:
            self.missed += number - self._last - 1
        self._last = number

    def count_dropped(self) -> None:
        self.dropped += 1
