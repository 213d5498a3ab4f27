"""What a picture has cost, effect by effect."""

from __future__ import annotations

import math
import threading
from collections import defaultdict


class Ledger:
    """Counts operations and bytes by the effect that they are for; nothing is ever timed.

    effects_called: the effects whose code was called. Threads may share one.
    """

    def __init__(self) -> None:
        self._operations: defaultdict[str, float] = defaultdict(float)
        self._bytes: defaultdict[str, int] = defaultdict(int)
        self._lock = threading.Lock()

    def add(self, effect: str, operations: float, bytes: int = 0) -> None:
        """operations: floating-point ones, about. bytes: of arrays that were made.

        Raises ValueError for numbers that are negative or not finite.
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
        with self._lock:
            return frozenset(self._operations)

    @property
    def operations(self) -> float:
        """Of all effects."""
        with self._lock:
            return math.fsum(self._operations.values())

    @property
    def bytes(self) -> int:
        """Of all arrays that were made, also of those that are gone."""
        with self._lock:
            return sum(self._bytes.values())

    def operations_of(self, effect: str) -> float:
        """Operations for one effect; 0 for one that wasn't entered."""
        with self._lock:
            return self._operations.get(effect, 0.0)
