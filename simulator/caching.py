"""A least-recently-used cache of the simulator's results."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar

T = TypeVar("T")


class Cache:
    """Keep the `size` most recently used results under hashable keys.

    Threads may share one cache.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._kept: OrderedDict[Hashable, object] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: Hashable, compute: Callable[[], T]) -> T:
        """Return the simulation result kept under `key`, or compute and keep it."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]  # type: ignore[return-value]
        # The lock isn't held here: a simulated camera that timed out may still compute while its
        # replacement starts to.
        result = compute()
        with self._lock:
            self._kept[key] = result
            while len(self._kept) > self._size:
                self._kept.popitem(last=False)
        return result

    def __contains__(self, key: Hashable) -> bool:
        """Return whether a simulation result is kept under `key`."""
        with self._lock:
            return key in self._kept

    def clear(self) -> None:
        """Remove all simulation results from the cache."""
        with self._lock:
            self._kept.clear()
