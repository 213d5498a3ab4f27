"""Results that are kept because they will be asked for again, as far as memory allows."""

from __future__ import annotations

import functools
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from typing import ParamSpec, TypeVar

import numpy as np
import torch

T = TypeVar("T")
P = ParamSpec("P")

_OVERHEAD_BYTES = 1024
"""Bytes that whatever has no size of its own counts as."""


class ByteCache:
    """The last results, by what they follow from, as far as memory allows.

    limit: bytes of all that is kept. What is larger than that alone isn't kept. Causes are
    compared by value; those that have no value but themselves are kept alive with the result, so
    that no other can take their place.
    """

    def __init__(self, limit: int = 2 << 30) -> None:
        if limit < 0:
            raise ValueError(f"limit is {limit} bytes; it can't be negative. 0 keeps nothing")
        self.limit = limit
        self._entries: OrderedDict[Hashable, tuple[object, int]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    @property
    def bytes(self) -> int:
        """Of all that is kept now."""
        return self._bytes

    def get(self, key: Hashable, compute: Callable[[], T]) -> T:
        """What follows from key: what is kept of them, or computed now."""
        with self._lock:
            if key in self._entries:
                self._entries.move_to_end(key)
                return self._entries[key][0]  # type: ignore[return-value]
        # Not under the lock: a camera that was given up may still compute when the next one does.
        result = compute()
        size = result_bytes(result)
        if size <= self.limit:
            with self._lock:
                self._store(key, result, size)
        return result

    def _store(self, key: Hashable, result: object, size: int) -> None:
        if key in self._entries:
            self._bytes -= self._entries.pop(key)[1]
        self._entries[key] = (result, size)
        self._bytes += size
        while self._bytes > self.limit:
            self._bytes -= self._entries.popitem(last=False)[1][1]

    def clear(self) -> None:
        with self._lock:
            self._entries.clear()
            self._bytes = 0


def byte_limited_cache(limit: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Let a function keep its last results for the whole process, up to so many bytes of them.

    For what follows from a few numbers alone, whoever asks. What belongs to somebody (a bench, a
    picture) is kept by its owner, and goes with it.
    """
    cache = ByteCache(limit)

    def decorate(find: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(find)
        def wrapper(*args: P.args, **options: P.kwargs) -> T:
            causes = (find, args, tuple(sorted(options.items())))
            return cache.get(causes, lambda: find(*args, **options))

        return wrapper

    return decorate


def result_bytes(value: object) -> int:
    """Bytes of a result: of its arrays, and of what tells an Account of its own."""
    if isinstance(value, torch.Tensor):
        return max(value.numel() * value.element_size(), 1)
    if isinstance(value, np.ndarray):
        return max(value.nbytes, 1)
    if isinstance(value, Mapping):
        return _OVERHEAD_BYTES + sum(result_bytes(one) for one in value.values())
    if isinstance(value, (list, tuple)):
        return _OVERHEAD_BYTES + sum(result_bytes(one) for one in value)
    reported_bytes = getattr(getattr(value, "account", value), "bytes", None)
    return _OVERHEAD_BYTES + (reported_bytes if isinstance(reported_bytes, int) else 0)
