"""Checks of options from the bench file, before a device is opened."""

from __future__ import annotations

import math
from typing import TypeGuard


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite number; true and false don't count."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def require_within(name: str, value: object, least: float, most: float) -> None:
    """Raise ValueError unless the value is a number from `least` to `most`."""
    if not is_number(value) or not least <= value <= most:
        raise ValueError(f"{name} is {value!r}; it must be from {least:g} to {most:g}")


def require_names(name: str, value: object) -> tuple[str, ...]:
    """Return the names as a tuple; ValueError if the value isn't a list of them."""
    if not isinstance(value, list | tuple) or not all(isinstance(one, str) for one in value):
        raise ValueError(f"{name} is {value!r}; give a list of names in quotes, such as ['one']")
    return tuple(value)
