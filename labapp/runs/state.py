"""The states of a run."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """COMPLETE means that every planned frame was read back from the file."""

    PLANNED = "PLANNED"
    RUNNING = "RUNNING"
    PAUSED = "PAUSED"
    COMPLETE = "COMPLETE"
    CANCELLED = "CANCELLED"
    FAILED = "FAILED"
    INTERRUPTED = "INTERRUPTED"
    """Never written: how a file reads whose writer is gone without a word."""


ENDED = (State.COMPLETE, State.CANCELLED, State.FAILED)
"""States that a run ends in and says so."""
