"""Parse exposure times that a person gives: seconds, fractions or EV steps."""

from __future__ import annotations

import math
import re

from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_number, split_list

_EV = re.compile(r"(.+?)\s*ev", re.IGNORECASE)
_FRACTION = re.compile(r"([^/]+)/([^/]+)")

_FORMS = (
    "are seconds with commas between them, as in 0.001,0.008 or 1/250,1/60,0.25; or steps of EV, "
    "as in -2ev,0ev,+2ev"
)


def parse_exposures(text: str) -> list[float]:
    """Return exposure times in seconds, from a person's words.

    "1/250,1/60,0.25" are seconds; "-2ev,0ev,+2ev" are powers of two, of one second. Raises
    UserError that names the value that isn't understood.
    """
    try:
        parts = [one.strip() for one in split_list(text)]
    except ValueError as error:
        raise UserError(f"--exposures {text}: {error}. They {_FORMS}.") from error
    steps = [_EV.fullmatch(one) for one in parts]
    if any(steps) and not all(steps):
        other = next(part for part, step in zip(parts, steps, strict=True) if not step)
        raise UserError(
            f"--exposures {text}: {other!r} isn't in EV, as others are. Give EV for all frames, or "
            "seconds for all."
        )
    return [_seconds(part, text) for part in parts]


def _seconds(part: str, text: str) -> float:
    """Return one exposure time in seconds."""
    try:
        if step := _EV.fullmatch(part):
            value = 2.0 ** parse_number(step[1])
        elif fraction := _FRACTION.fullmatch(part):
            value = parse_number(fraction[1]) / parse_number(fraction[2], "s")
        else:
            value = parse_number(part, "s")
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        raise UserError(f"--exposures {text}: {part!r} isn't a time. They {_FORMS}.") from error
    if not 0 < value < math.inf:
        raise UserError(f"--exposures: {part} can't be; all must be positive.")
    return value
