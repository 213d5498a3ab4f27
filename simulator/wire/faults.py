"""What may go wrong on a cable."""

from __future__ import annotations

import math
from dataclasses import dataclass

WIRE_FAULT_KINDS = (
    "silence",
    "mute",
    "garbage",
    "truncated",
    "duplicated",
    "delayed",
    "bit flips",
    "byte by byte",
    "wrong echo",
    "disconnect",
)
"""silence: nothing is heard, nothing answered. mute: heard, but the answers are lost.
garbage: other bytes in place of answers. truncated: answers lose their end. duplicated:
answers come twice. delayed: answers come late. bit flips: noise, in both directions.
byte by byte: with pauses between. wrong echo: other characters are echoed than were sent.
disconnect: the plug is out. A machine's own kinds come besides."""

_DEFAULT_SHARES = {"bit flips": 0.03}


@dataclass(frozen=True)
class WireFault:
    """One thing that goes wrong, and when.

    kind: one of WIRE_FAULT_KINDS, or one of the machine's own faults. at: time of the bench, in
    seconds, at which it begins. seconds: how long it lasts. share: of what it can strike
    (bytes for bit flips, answers or echoes else) is struck; by default all of it, but 3 % of
    bytes by bit flips. delay: seconds by which delayed answers come later.
    """

    kind: str
    at: float = 0.0
    seconds: float = math.inf
    share: float | None = None
    delay: float = 3.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.at) and self.seconds >= 0 and 0 <= self.delay < math.inf):
            raise ValueError(
                f"at is {self.at}, seconds {self.seconds}, delay {self.delay}; "
                "at and delay must be finite, seconds and delay not negative"
            )
        if self.share is not None and not 0 <= self.share <= 1:
            raise ValueError(f"share is {self.share}; it must be from 0 to 1")

    @property
    def probability(self) -> float:
        """The chance of each thing that can be struck to be struck."""
        return _DEFAULT_SHARES.get(self.kind, 1.0) if self.share is None else self.share

    def is_active(self, t: float) -> bool:
        return self.at <= t < self.at + self.seconds
