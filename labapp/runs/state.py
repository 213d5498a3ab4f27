"""The states of a run."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """COMPLETE means that every planned frame was read back from the file."""

    WAITING = "WAITING"
    """Never written: of a run in line, which has no file yet."""

    PLANNED = "PLANNED"
    RUNNING = "RUNNING"
    PAUSED = "PAUSED"
    COMPLETE = "COMPLETE"
    CANCELLED = "CANCELLED"
    FAILED = "FAILED"
    INTERRUPTED = "INTERRUPTED"
    """Never written: how a file reads whose writer is gone without a word."""

    @property
    def is_under_way(self) -> bool:
        return self in (State.RUNNING, State.PAUSED)

    @property
    def has_ended(self) -> bool:
        """Whether a run ended so, and said so."""
        return self in (State.COMPLETE, State.CANCELLED, State.FAILED)
