"""A machine whose answers are spoilt: random bytes, changed ones, old ones, none."""

from __future__ import annotations

from collections import deque

import numpy as np

from simulator.machines.machine import Reply, SerialMachine

_KEPT = 16


class FuzzedMachine:
    """Another machine, which hears all, but whose answers chance changes.

    machine: the other one. share: of its answers that are changed, its echoes included.
    changed: how many were, so far. What is asked of it is carried out truly.
    """

    own_faults: tuple[str, ...] = ()

    def __init__(self, machine: SerialMachine, rng: np.random.Generator, share: float) -> None:
        self.machine = machine
        self.share = share
        self.changed = 0
        self._rng = rng
        self._said: deque[bytes] = deque(maxlen=_KEPT)

    def set_fault(self, kind: str | None) -> None:
        """Nothing besides."""

    def feed(self, data: bytes, t: float) -> list[Reply]:
        return [self._spoil(reply) for reply in self.machine.feed(data, t)]

    def _spoil(self, reply: Reply) -> Reply:
        if not reply.data:
            return reply
        self._said.append(reply.data)
        if self._rng.random() >= self.share:
            return reply
        self.changed += 1
        # No data would be an appointment.
        return Reply(reply.at, self._changed(reply.data) or b"\0")

    def _changed(self, data: bytes) -> bytes:
        rng = self._rng
        place = int(rng.integers(len(data)))
        kind = int(rng.integers(7))
        if kind == 0:
            return rng.bytes(int(rng.integers(1, 64)))
        if kind == 1:
            return self._said[int(rng.integers(len(self._said)))]
        if kind == 2:
            return data + self._said[int(rng.integers(len(self._said)))]
        if kind == 3:
            return data[:place]
        if kind == 4:
            return data[:place] + rng.bytes(1) + data[place:]
        digits = [i for i, byte in enumerate(data) if chr(byte).isdecimal()]
        if kind == 5 and digits:
            place = digits[int(rng.integers(len(digits)))]
            return data[:place] + bytes([48 + int(rng.integers(10))]) + data[place + 1 :]
        return data[:place] + rng.bytes(1) + data[place + 1 :]
