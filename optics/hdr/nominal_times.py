"""Exposure times as cameras tell them, rounded, and as they are.

Shutters step by thirds of a stop, 2^(1/3); what is told are the customary numbers: 1/60 s for
1/64 s, 1/15 s for 1/16 s, 30 s for 32 s (ISO 516 allows for them).
"""

from __future__ import annotations

import math

_STEPS_PER_STOP = 3

_FAST = (
    8000, 6400, 5000, 4000, 3200, 2500, 2000, 1600, 1250, 1000, 800, 640, 500, 400, 320, 250, 200,
    160, 125, 100, 80, 60, 50, 40, 30, 25, 20, 15, 13, 10, 8, 6, 5, 4,
)  # fmt: skip
_SLOW = (
    0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 15.0,
    20.0, 25.0, 30.0, 60.0,
)  # fmt: skip

NOMINAL_TIMES = (*(1 / one for one in _FAST), *_SLOW)
"""Customary exposure times of cameras, seconds, the shortest first."""

_SAME = 0.006
"""Relative difference up to which a time is a customary one. Chosen: .017 s is 1/60 s to 2 %, and
isn't taken for it; .0167 s is."""


def is_nominal(time: float) -> bool:
    """Return whether an exposure time in seconds is one of the customary numbers."""
    return any(abs(time / one - 1) < _SAME for one in NOMINAL_TIMES)


def shutter_time(time: float) -> float:
    """Return the exposure time that a camera means by a customary number: 1/64 s by 1/60 s.

    time: seconds; others than customary ones are returned as they are.
    """
    if not is_nominal(time):
        return time
    return float(2.0 ** (round(_STEPS_PER_STOP * math.log2(time)) / _STEPS_PER_STOP))
