"""All that was measured for the page, and what was left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import labapp
from labapp.accuracy.overview.measured import MeasuredOperation


@dataclass(frozen=True)
class LeftOut:
    """An operation that wasn't measured, and why."""

    name: str
    title: str
    why: str


@dataclass(frozen=True)
class Outcome:
    """All that was measured.

    machine, scope: the machine, and the camera that was measured, in words.
    left_out: operations that weren't measured.
    seconds: wall-clock time of the whole.
    cancelled: whether a person stopped it.
    """

    machine: str
    scope: str
    operations: Sequence[MeasuredOperation]
    left_out: Sequence[LeftOut]
    seconds: float
    cancelled: bool

    def as_data(self) -> dict[str, Any]:
        """Return everything as plain data for JSON."""
        return {
            "version": labapp.__version__,
            "machine": self.machine,
            "scope": self.scope,
            "seconds": self.seconds,
            "cancelled": self.cancelled,
            "left_out": [vars(one) for one in self.left_out],
            "operations": [one.as_data() for one in self.operations],
        }
