"""Ranges of numbers that come from files, options and drivers, by their units."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Range:
    """Largest size of a number of a unit, and the least of one that has to be positive. Chosen.

    Beyond them nobody means the number, and squares and products leave what doubles, or singles in
    pictures, can hold. Who declares a narrower range keeps it.
    """

    least: float
    most: float
    unit: str = ""

    def in_words(self, end: Literal["least", "most"]) -> str:
        return f"{getattr(self, end):g} {self.unit}".rstrip()


_RANGES = {
    "_per_s": Range(1e-12, 1e15),
    "_mm_s": Range(1e-9, 1e9, "mm/s"),
    "_per_nm": Range(1e-9, 1e9),
    "_nm": Range(1e-6, 1e9, "nm"),
    "_um": Range(1e-6, 1e9, "µm"),
    "_mm": Range(1e-6, 1e9, "mm"),
    "_m": Range(1e-9, 1e15, "m"),
    "_us": Range(1e-6, 1e12, "µs"),
    "_ms": Range(1e-9, 1e12, "ms"),
    "_s": Range(1e-12, 1e9, "s"),
    "_hz": Range(1e-9, 1e15, "Hz"),
    "_rad": Range(1e-9, 1e9, "rad"),
    "_deg": Range(1e-9, 1e9, "°"),
    "_db": Range(1e-9, 1e6, "dB"),
    "_px": Range(1e-6, 1e9, "pixels"),
    "f_number": Range(1e-3, 1e6),
    "seed": Range(0.0, 2.0**64 - 1),
    "metadata": Range(0.0, math.inf),
    # Of light in a picture's own unit, which may be watts or photons.
    **dict.fromkeys(("noise", "clip", "dark", "black", "white", "full_scale"), Range(1e-60, 1e60)),
}
"""By the ending of a name, the first that fits. 1e15 m are a tenth of a light year."""

_OTHERS = Range(1e-15, 1e15)
"""Of numbers whose name tells no unit: shares, tolerances, radiances, electrons."""


@functools.cache
def range_of(name: str) -> Range:
    """Return the range of an option's or a file key's numbers, by the name's ending."""
    return next((one for end, one in _RANGES.items() if name.endswith(end)), _OTHERS)


def require_range(name: str, value: Any, *, positive: bool = False) -> Any:
    """Return a number from outside, with -0 as 0; ValueError if nobody can mean it.

    positive: whether it has to be more than 0, so that it may be divided by. Infinity passes.
    """
    limits, size = range_of(name), abs(value)
    if limits.most < size < math.inf:
        raise ValueError(f"give a size of at most {limits.in_words('most')}, and check its unit")
    if positive and 0 < size < limits.least:
        raise ValueError(f"give a size of at least {limits.in_words('least')}, and check its unit")
    return value or size
