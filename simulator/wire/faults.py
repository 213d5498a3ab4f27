"""Faults of a cable: their kinds and times."""

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
"""Kinds of faults on a wire; each machine has further kinds of its own.

silence: bytes are lost in both directions. mute: replies are lost. garbage: other bytes replace a
reply. truncated: replies lose their end. duplicated: replies come twice. delayed: replies come
late. bit flips: noise in both directions. byte by byte: replies have pauses between their bytes.
wrong echo: the echo differs from what was sent. disconnect: the plug is out."""


@dataclass(frozen=True)
class WireFault:
    """One fault of a cable or of the instrument behind it, and its time.

    Parameters
    ----------
    kind : str
        One of WIRE_FAULT_KINDS, or one of the machine's own faults.
    at, seconds : float, default 0.0, inf
        When it begins by the bench's clock, and how long it lasts, not negative, in seconds.
    share : float, optional
        Share from 0 to 1 of the bytes (for bit flips) or of the replies and echoes (for other
        kinds) that the fault affects. By default it is 0.03 for bit flips and otherwise 1.
    delay : float, default 3.0
        Seconds by which the kind "delayed" delays replies, finite and not negative.

    Raises
    ------
    ValueError
        If a number is outside its range.
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
        """Return the probability that the fault affects a byte, reply or echo."""
        default = 0.03 if self.kind == "bit flips" else 1.0
        return default if self.share is None else self.share

    def is_active(self, t: float) -> bool:
        return self.at <= t < self.at + self.seconds
