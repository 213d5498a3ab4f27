"""The outcome of measuring for the accuracy page: operations, and what was left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import labapp
from labapp.accuracy.overview.measured import MeasuredOperation


@dataclass(frozen=True)
class LeftOut:
    """An operation that isn't on the accuracy page, and why."""

    name: str
    title: str
    why: str


@dataclass(frozen=True)
class Outcome:
    """All that was measured for the accuracy page.

    Attributes
    ----------
    machine, scope : str
        The machine, and the camera that was measured, in words.
    operations : sequence of MeasuredOperation
        What was measured.
    left_out : sequence of LeftOut
        What wasn't.
    seconds : float
        Wall-clock time of the whole.
    cancelled : bool
        Whether a person stopped it.
    """

    machine: str
    scope: str
    operations: Sequence[MeasuredOperation]
    left_out: Sequence[LeftOut]
    seconds: float
    cancelled: bool

    def as_data(self) -> dict[str, Any]:
        """Return all that was measured for the accuracy page as plain data for JSON."""
        return {
            "version": labapp.__version__,
            "machine": self.machine,
            "scope": self.scope,
            "seconds": self.seconds,
            "cancelled": self.cancelled,
            "left_out": [vars(one) for one in self.left_out],
            "operations": [one.as_data() for one in self.operations],
        }
