"""What a simulated serial instrument is: bytes in, bytes out, and the time."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Reply(NamedTuple):
    """Bytes that begin to leave the machine at `at`, in seconds of the bench's clock.

    Without data it is an appointment: the machine is fed b"" at that time, so that it can go
    on with what takes time, and needs to foretell nothing that might still be aborted.
    """

    at: float
    data: bytes


class FaultyMachine:
    """A machine that may have several of its own faults at once."""

    def __init__(self) -> None:
        self._faults: set[str] = set()

    def set_fault(self, kind: str | None) -> None:
        """One of its own faults begins, or (None) all of them end."""
        if kind is None:
            self._faults.clear()
        else:
            self._faults.add(kind)


class SerialMachine(Protocol):
    """An instrument that knows neither ports nor worlds.

    own_faults: what can go wrong within it, in words.
    """

    own_faults: tuple[str, ...]

    def feed(self, data: bytes, t: float) -> list[Reply]:
        """Bytes that arrive at t, which never goes back; what leaves from then on."""
        ...

    def set_fault(self, kind: str | None) -> None:
        """One of `own_faults` begins, or (None) all of them end."""
        ...
