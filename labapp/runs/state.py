"""The states of a run, from the plan to its end."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """How a run stands; COMPLETE means that every planned frame was read back from the record."""

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
        """Whether it is running or paused."""
        return self in (State.RUNNING, State.PAUSED)

    @property
    def has_ended(self) -> bool:
        """Whether it ended and wrote its final state."""
        return self in (State.COMPLETE, State.CANCELLED, State.FAILED)
