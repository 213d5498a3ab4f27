"""Every figure that labapp claims, measured beside its goal: `make figures`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Figure:
    """One figure: what, the goal in words, what was measured, and whether it is met.

    met is None where it could not be measured; `measured` then says why.
    """

    name: str
    goal: str
    measured: str
    met: bool | None


Measurement = Callable[[Path], Iterable[Figure]]
"""Measure in a folder of its own; may give several figures that are found in one go."""
