"""Keep results of computations in memory for later calls, up to a limit in bytes."""

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


class HashedKey:
    """A cache key of many parts whose hash is computed once; keys of equal parts are equal."""

    __slots__ = ("_hash", "_parts")

    def __init__(self, *parts: Hashable) -> None:
        self._parts, self._hash = parts, hash(parts)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return isinstance(other, HashedKey) and self._parts == other._parts


class ByteCache:
    """Cache the results of computations up to a limit in bytes, and drop the oldest beyond it.

    limit: bytes of all results together. A single result larger than the limit isn't kept. Keys
    are compared by value. A key that is compared by identity stays alive with its result, so that
    no other object can get the same identity.
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
        """The bytes of all results together."""
        return self._bytes

    def get(self, key: Hashable, compute: Callable[[], T]) -> T:
        """Return the result of a key, or compute and keep it."""
        with self._lock:
            if key in self._entries:
                self._entries.move_to_end(key)
                return self._entries[key][0]  # type: ignore[return-value]
        # This runs without the lock, so that two threads can compute at the same time: a camera
        # that was given up may still compute when the next one starts.
        result = compute()
        size = self.size_of(result)
        if size <= self.limit:
            with self._lock:
                if key in self._entries:
                    self._bytes -= self._entries.pop(key)[1]
                self._entries[key] = (result, size)
                self._bytes += size
                while self._bytes > self.limit:
                    self._bytes -= self._entries.popitem(last=False)[1][1]
        return result

    def size_of(self, result: object) -> int:
        """Return what a result counts against the limit."""
        return result_bytes(result)

    def clear(self) -> None:
        with self._lock:
            self._entries.clear()
            self._bytes = 0


def byte_limited_cache(limit: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorate a function with a cache of its results, of at most `limit` bytes.

    The cache lives as long as the process. It is for results that follow from a few numbers
    alone. Results that belong to an object (a bench, a picture) are kept by that object instead,
    so that they are freed with it.
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
    """Estimate the bytes that a result takes in memory.

    Arrays count with their size, and objects with an Account with the bytes that it states. Any
    other object counts as 1 KiB.
    """
    overhead = 1024
    if isinstance(value, torch.Tensor):
        return max(value.numel() * value.element_size(), 1)
    if isinstance(value, np.ndarray):
        return max(value.nbytes, 1)
    if isinstance(value, Mapping):
        return overhead + sum(result_bytes(one) for one in value.values())
    if isinstance(value, (list, tuple)):
        return overhead + sum(result_bytes(one) for one in value)
    reported_bytes = getattr(getattr(value, "account", value), "bytes", None)
    return overhead + (reported_bytes if isinstance(reported_bytes, int) else 0)
