"""What options of devices are checked for, before anything is opened."""

from __future__ import annotations

import math
from typing import TypeGuard


def is_number(value: object) -> TypeGuard[float]:
    """Whether it is a finite number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def require_within(name: str, value: object, least: float, most: float) -> None:
    """Raise ValueError for what is no number from the least to the most."""
    if not is_number(value) or not least <= value <= most:
        raise ValueError(f"{name} is {value!r}; it must be from {least:g} to {most:g}")
