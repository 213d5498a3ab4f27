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

_SMALL = 1024
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
        self._kept: OrderedDict[Hashable, tuple[object, int]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    @property
    def bytes(self) -> int:
        """Of all that is kept now."""
        return self._bytes

    def get(self, causes: Hashable, compute: Callable[[], T]) -> T:
        """What follows from causes: what is kept of them, or computed now."""
        with self._lock:
            if causes in self._kept:
                self._kept.move_to_end(causes)
                return self._kept[causes][0]  # type: ignore[return-value]
        # Not under the lock: a camera that was given up may still compute when the next one does.
        result = compute()
        size = bytes_of(result)
        if size <= self.limit:
            with self._lock:
                self._keep(causes, result, size)
        return result

    def _keep(self, causes: Hashable, result: object, size: int) -> None:
        if causes in self._kept:
            self._bytes -= self._kept.pop(causes)[1]
        self._kept[causes] = (result, size)
        self._bytes += size
        while self._bytes > self.limit:
            self._bytes -= self._kept.popitem(last=False)[1][1]

    def clear(self) -> None:
        with self._lock:
            self._kept.clear()
            self._bytes = 0


def keep_within(limit: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Let a function keep its last results for the whole process, up to so many bytes of them.

    For what follows from a few numbers alone, whoever asks. What belongs to somebody (a bench, a
    picture) is kept by its owner, and goes with it.
    """
    cache = ByteCache(limit)

    def keep(find: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(find)
        def wrapper(*args: P.args, **options: P.kwargs) -> T:
            causes = (find, args, tuple(sorted(options.items())))
            return cache.get(causes, lambda: find(*args, **options))

        return wrapper

    return keep


def bytes_of(value: object) -> int:
    """Bytes of a result: of its arrays, and of what tells an Account of its own."""
    if isinstance(value, torch.Tensor):
        return max(value.numel() * value.element_size(), 1)
    if isinstance(value, np.ndarray):
        return max(value.nbytes, 1)
    if isinstance(value, Mapping):
        return _SMALL + sum(bytes_of(one) for one in value.values())
    if isinstance(value, (list, tuple)):
        return _SMALL + sum(bytes_of(one) for one in value)
    told = getattr(getattr(value, "account", value), "bytes", None)
    return _SMALL + (told if isinstance(told, int) else 0)
