"""Exposure brackets: a ladder of exposure times, or exposures to be chosen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

DARK_FRAMES, STAR_FRAMES = 4, 2
"""Dark and star frames at each exposure time. The darks' noise enters every corrected picture."""


@dataclass(frozen=True)
class ExposureBracket:
    """`count` exposures from `shortest_ms` milliseconds, each `ratio` times the last."""

    shortest_ms: float
    ratio: float
    count: int

    @property
    def exposures_ms(self) -> tuple[float, ...]:
        """Return the exposures in ms, rounded to the whole microseconds of cameras."""
        return tuple(round(self.shortest_ms * self.ratio**n, 3) for n in range(self.count))


@dataclass(frozen=True)
class SNRBracket:
    """Ask for exposures that reach a signal-to-noise ratio over some decades of light.

    The run meters its targets, and chooses them.
    snr_db: 20 log10, of each merged pixel.
    """

    snr_db: float
    decades: float

    @property
    def exposures_ms(self) -> tuple[float, ...]:
        """Return none: the exposures aren't known before the light is metered."""
        return ()


@dataclass(frozen=True)
class ProposedBracket:
    """Exposures that were proposed for the light in the picture, each frame's in milliseconds.

    An exposure may be there several times. `why` says what they were proposed for.
    """

    exposures_ms: tuple[float, ...]
    why: str

    @property
    def count(self) -> int:
        """Return the number of frames at each setting."""
        return len(self.exposures_ms)


def list_exposures(exposures_ms: Sequence[float]) -> str:
    """List a bracket's exposures, as "1  8 (3 times)  64 ms"; empty for none."""
    groups = Counter(exposures_ms)
    listed = (f"{ms:.6g}" + (f" ({n} times)" if n > 1 else "") for ms, n in groups.items())
    return "  ".join(listed) + " ms" if groups else ""


RequestedBracket = ExposureBracket | SNRBracket | ProposedBracket
