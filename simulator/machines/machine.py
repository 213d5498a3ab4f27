"""What a serial instrument of the virtual bench can do: bytes in, replies with their times out."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Reply(NamedTuple):
    """Bytes that begin to leave the instrument at `at`, in seconds of the bench's clock.

    A reply without data is a wake-up call: the machine is fed b"" at that time. A machine whose
    work takes time continues then, so it needn't promise a reply that might still be aborted.
    """

    at: float
    data: bytes


class FaultyMachine:
    """Base of instruments that can have several of their own faults at once."""

    def __init__(self) -> None:
        self._faults: set[str] = set()

    def set_fault(self, kind: str | None) -> None:
        """Begin one of the instrument's own faults, or end them all if `kind` is None."""
        if kind is None:
            self._faults.clear()
        else:
            self._faults.add(kind)


class SerialMachine(Protocol):
    """A serial instrument, independent of ports and of the virtual bench.

    own_faults: names of the faults that can occur within it.
    """

    own_faults: tuple[str, ...]

    def feed(self, data: bytes, t: float) -> list[Reply]:
        """Give the instrument bytes at time t; return the replies sent from then on.

        The time never decreases from call to call.
        """

    def set_fault(self, kind: str | None) -> None:
        """Begin one of `own_faults`, or end all if `kind` is None."""
