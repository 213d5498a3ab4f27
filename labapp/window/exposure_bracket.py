"""A bracket: exposures that grow by a ratio."""

from __future__ import annotations

from dataclasses import dataclass

DARK_FRAMES, STAR_FRAMES = 4, 2
"""Frames of each exposure: the noise of the darks goes into every picture."""


@dataclass(frozen=True)
class ExposureBracket:
    """`count` exposures from `shortest_ms` milliseconds, each `ratio` times the last."""

    shortest_ms: float
    ratio: float
    count: int

    @property
    def exposures_ms(self) -> tuple[float, ...]:
        """Milliseconds, to the whole microseconds that cameras count in."""
        return tuple(round(self.shortest_ms * self.ratio**n, 3) for n in range(self.count))
