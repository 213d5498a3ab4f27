"""Serial cable between a port and a machine: timing of the bytes, and faults."""

from __future__ import annotations

import heapq
import itertools
import math
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from simulator.machines.machine import Reply, SerialMachine
from simulator.wire.faults import WIRE_FAULT_KINDS, WireFault


class SimulatedLine:
    """Simulate a serial cable to an instrument, by the bench's clock.

    Events happen in the order of their times, when a call passes the present time. A fault affects
    the bytes that pass while it lasts. Any thread may call.

    Parameters
    ----------
    machine : SerialMachine
        The instrument at the far end.
    baudrate : int
        Bits per second, positive; a byte takes 10 bits.
    seed : int, default 0
        Seed of the faults' random numbers.

    Raises
    ------
    ValueError
        If the baud rate isn't positive.
    """

    def __init__(self, machine: SerialMachine, *, baudrate: int, seed: int = 0) -> None:
        if baudrate <= 0:
            raise ValueError(f"baudrate is {baudrate}; it must be positive")
        self.machine, self.baudrate = machine, baudrate
        # A byte has a start bit, eight data bits and a stop bit.
        self._byte_time = 10 / baudrate
        self._rng = np.random.default_rng(seed)
        self._count = itertools.count()
        self._going: list[tuple[float, int, int]] = []
        self._leaving: list[tuple[float, int, bytes, bool]] = []
        self._coming: list[tuple[float, int, int]] = []
        self._free_there = self._free_here = -math.inf
        self._faults: dict[str, list[WireFault]] = {}
        self._cleared_unplugs, self._now = 0, -math.inf
        self._machine_faults: tuple[str, ...] = ()
        self._lock = threading.RLock()

    def send(self, data: bytes, t: float) -> None:
        """Send bytes from the host, beginning at time t."""
        with self._lock:
            self._advance(t)
            for byte in data:
                self._free_there = max(t, self._free_there) + self._byte_time
                heapq.heappush(self._going, (self._free_there, next(self._count), byte))

    def receive(self, t: float) -> bytes:
        """Return the bytes that reached the host since the last call.

        t: the present time.
        """
        with self._lock:
            self._advance(t)
            arrived = bytearray()
            while _first_time(self._coming) <= t:
                arrived.append(heapq.heappop(self._coming)[2])
            return bytes(arrived)

    def next_event_time(self) -> float:
        """Return when something may happen next; infinite if nothing will."""
        with self._lock:
            return min(
                _first_time(self._going), _first_time(self._leaving), _first_time(self._coming)
            )

    def inject(self, fault: WireFault) -> None:
        """Add a fault.

        Raises ValueError if neither the cable nor its machine knows this kind.
        """
        known = (*WIRE_FAULT_KINDS, *self.machine.own_faults)
        if fault.kind not in known:
            raise ValueError(f"kind is {fault.kind!r}; choose one of {', '.join(known)}")
        with self._lock:
            self._faults.setdefault(fault.kind, []).append(fault)

    def clear_faults(self) -> None:
        """End all faults; bytes that they have delayed still arrive."""
        with self._lock:
            self._cleared_unplugs = self.unplug_count(self._now)
            self._faults.clear()
            self._update_machine_faults(self._now)

    def is_unplugged(self, t: float) -> bool:
        """Return whether the cable is unplugged at time t."""
        return self._active_fault("disconnect", t) is not None

    def unplug_count(self, t: float) -> int:
        """Return how often the cable has been unplugged by time t.

        A port that was opened before the last time is no longer valid.
        """
        with self._lock:
            pulls = self._faults.get("disconnect")
            return self._cleared_unplugs + (sum(one.at <= t for one in pulls) if pulls else 0)

    def next_unplug_time(self, t: float) -> float:
        """Return when the cable is unplugged next, infinite if it isn't."""
        with self._lock:
            pulls = self._faults.get("disconnect", ())
            return min((fault.at for fault in pulls if fault.at > t), default=math.inf)

    def _advance(self, t: float) -> None:
        """Carry out all events until time t, in their order."""
        self._now = max(self._now, t)
        while self._going or self._leaving:
            going, leaving = _first_time(self._going), _first_time(self._leaving)
            if going > t and leaving > t:
                break
            if going <= leaving:
                at, _, byte = heapq.heappop(self._going)
                if not (self._active_fault("silence", at) or self._active_fault("disconnect", at)):
                    self._feed(bytes([self._with_bit_flips(byte, at)]), at)
            else:
                at, _, data, echo = heapq.heappop(self._leaving)
                if data:
                    self._transmit_reply(data, at, echo)
                else:
                    self._feed(b"", at)
        if self.is_unplugged(t):
            self._coming.clear()

    def _feed(self, data: bytes, t: float) -> None:
        """Pass bytes to the machine, and take its replies."""
        self._update_machine_faults(t)
        for reply in self.machine.feed(data, t):
            echo = bool(data) and reply == Reply(t, data)
            at = max(reply.at, t)
            heapq.heappush(self._leaving, (at, next(self._count), reply.data, echo))

    def _update_machine_faults(self, t: float) -> None:
        own = self.machine.own_faults
        now = tuple(kind for kind in own if self._active_fault(kind, t))
        if now == self._machine_faults:
            return
        self._machine_faults = now
        self.machine.set_fault(None)
        for kind in now:
            self.machine.set_fault(kind)

    def _transmit_reply(self, data: bytes, t: float, echo: bool) -> None:
        """Send the machine's bytes to the host, as faults change them."""
        if any(self._active_fault(kind, t) for kind in ("silence", "mute", "disconnect")):
            return
        late = 0.0
        if not echo:
            if self._drawn_fault("garbage", t):
                data = self._rng.bytes(int(self._rng.integers(1, 2 * len(data) + 1)))
            if self._drawn_fault("truncated", t):
                data = data[: int(self._rng.integers(len(data)))]
            if self._drawn_fault("duplicated", t):
                data = data + data
            if delayed := self._drawn_fault("delayed", t):
                late = delayed.delay
        elif self._drawn_fault("wrong echo", t):
            data = bytes(byte ^ 1 for byte in data)
        pause = 0.02 if self._active_fault("byte by byte", t) else 0.0
        free = self._free_here
        for byte in data:
            free = max(t + late, free) + self._byte_time + pause
            heapq.heappush(self._coming, (free, next(self._count), self._with_bit_flips(byte, t)))
        if not late:
            # A delayed reply doesn't delay the bytes that follow it.
            self._free_here = free

    def _with_bit_flips(self, byte: int, t: float) -> int:
        flipped = self._drawn_fault("bit flips", t)
        return byte ^ (1 << int(self._rng.integers(8))) if flipped else byte

    def _active_fault(self, kind: str, t: float) -> WireFault | None:
        faults = self._faults.get(kind)
        return next((f for f in faults if f.is_active(t)), None) if faults else None

    def _drawn_fault(self, kind: str, t: float) -> WireFault | None:
        """Return a fault if it is active at time t and a random draw picks it."""
        fault = self._active_fault(kind, t)
        return fault if fault and self._rng.random() < fault.probability else None


def _first_time(heap: Sequence[tuple[Any, ...]]) -> float:
    """Return the time of the first pending event."""
    return heap[0][0] if heap else math.inf
