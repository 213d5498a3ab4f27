"""A machine behind a port of this process, and what is said on its line."""

from __future__ import annotations

from drivers.interfaces import Surroundings
from simulator.clock import VirtualClock
from simulator.wire import SimulatedLine, WireFault, plug_in, unplug


class Recorded(SimulatedLine):
    """A line that writes down, in turn, what the host sends and what it is given."""

    def __init__(self, machine, **options) -> None:
        super().__init__(machine, **options)
        self.talk: list[tuple[bytes, bytes]] = []

    def send(self, data, t):
        self.talk.append((bytes(data), b""))
        super().send(data, t)

    def receive(self, t):
        data = super().receive(t)
        if data:
            sent, came = self.talk[-1] if self.talk else (b"", b"")
            self.talk[-1:] = [(sent, came + data)]
        return data


class Bench:
    """A machine on a line at sim://bench, on a virtual clock."""

    def __init__(self, machine, baudrate: int = 115200) -> None:
        self.clock = VirtualClock()
        self.machine = machine
        self.line = Recorded(machine, baudrate=baudrate)
        self.url = plug_in("bench", self.line, self.clock)
        self.surroundings = Surroundings(self.clock)

    def said(self) -> list[tuple[bytes, bytes]]:
        """What was sent and what came back since the last time."""
        talk, self.line.talk = self.line.talk, []
        return talk

    def suffer(self, kind: str, after: float = 0.0, **how) -> None:
        self.line.inject(WireFault(kind, self.clock.now() + after, **how))

    def close(self) -> None:
        unplug("bench")
