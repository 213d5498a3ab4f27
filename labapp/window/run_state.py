"""How a run of the queue stands, in the words that the window shows."""

from __future__ import annotations

from enum import StrEnum


class RunState(StrEnum):
    """COMPLETE, CANCELLED and FAILED mean what they mean in a record."""

    WAITING = "WAITING"
    RUNNING = "RUNNING"
    PAUSED = "PAUSED"
    COMPLETE = "COMPLETE"
    CANCELLED = "CANCELLED"
    FAILED = "FAILED"

    @property
    def is_under_way(self) -> bool:
        return self in (RunState.RUNNING, RunState.PAUSED)

    @property
    def has_ended(self) -> bool:
        return self in (RunState.COMPLETE, RunState.CANCELLED, RunState.FAILED)
