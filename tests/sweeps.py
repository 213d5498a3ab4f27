"""Parameters of which `make test` tries some, and `make test-all` the others too."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def some(values: Iterable[Any], *tried: int) -> list[Any]:
    """`make test` tries those at the places `tried`, or else the first; the others are swept."""
    return [
        pytest.param(
            *(value if isinstance(value, tuple) else (value,)),
            marks=() if number in (tried or (0,)) else pytest.mark.sweep,
        )
        for number, value in enumerate(values)
    ]
