"""The states of a run."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """The state of a run; COMPLETE means that every planned frame was read back from the record."""

    WAITING = "WAITING"
    """A run in the queue, which has no record yet; this state is never written."""

    PLANNED = "PLANNED"
    RUNNING = "RUNNING"
    PAUSED = "PAUSED"
    COMPLETE = "COMPLETE"
    CANCELLED = "CANCELLED"
    FAILED = "FAILED"
    INTERRUPTED = "INTERRUPTED"
    """A run whose process ended without writing a final state; this state is never written."""

    @property
    def is_under_way(self) -> bool:
        """Whether the run is under way: running or paused."""
        return self in (State.RUNNING, State.PAUSED)

    @property
    def has_ended(self) -> bool:
        """Whether the run ended and wrote its final state."""
        return self in (State.COMPLETE, State.CANCELLED, State.FAILED)
