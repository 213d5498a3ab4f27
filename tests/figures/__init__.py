"""Every figure that labapp claims, measured beside its goal: `make figures`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

TOLD = "told"
"""The goal of a figure that has none but to be told."""


@dataclass(frozen=True)
class Figure:
    """One figure: what, the goal in words, what was measured, and whether it is met.

    met is None where it could not be measured, of which `measured` then says why, and where the
    goal is just to tell what was seen: `TOLD`.
    """

    name: str
    goal: str
    measured: str
    met: bool | None

    @property
    def verdict(self) -> str:
        """Whether the goal is met, in a word or two."""
        if self.met is None:
            return "" if self.goal == TOLD else "not measured"
        return "met" if self.met else "missed"


Measurement = Callable[[Path], Iterable[Figure]]
"""Measure in a folder of its own; may give several figures that are found in one go."""
