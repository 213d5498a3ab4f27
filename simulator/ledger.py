"""Counts of the operations and bytes that pictures take, by effect."""

from __future__ import annotations

import math
import threading
from collections import defaultdict


class Ledger:
    """Counts of operations and bytes by the effect that needed them; nothing is timed.

    effects_called: names of the effects whose code was called. Threads may share one ledger.
    """

    def __init__(self) -> None:
        self._operations: defaultdict[str, float] = defaultdict(float)
        self._bytes: defaultdict[str, int] = defaultdict(int)
        self._lock = threading.Lock()

    def add(self, effect: str, operations: float, bytes: int = 0) -> None:
        """Add an effect's floating-point operations, and the bytes of new arrays.

        operations: approximate number. Raises ValueError for numbers that are negative or not
        finite.
        """
        if not 0 <= operations < math.inf:
            raise ValueError(f"operations is {operations:g}; it must be finite, not negative")
        if bytes < 0:
            raise ValueError(f"bytes is {bytes}; it can't be negative")
        with self._lock:
            self._operations[effect] += operations
            self._bytes[effect] += bytes

    @property
    def effects_called(self) -> frozenset[str]:
        """Return the names of the effects whose code was called."""
        with self._lock:
            return frozenset(self._operations)

    @property
    def operations(self) -> float:
        """Return the number of operations of all effects."""
        with self._lock:
            return math.fsum(self._operations.values())

    @property
    def bytes(self) -> int:
        """Return the bytes of all new arrays, also of those since deleted."""
        with self._lock:
            return sum(self._bytes.values())

    def operations_of(self, effect: str) -> float:
        """Return the number of one effect's operations; 0 without an entry."""
        with self._lock:
            return self._operations.get(effect, 0.0)
