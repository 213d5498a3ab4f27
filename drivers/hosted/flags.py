"""Flags that stand for callables among the arguments of a call to another process."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from drivers.hosted.shared_memory_channel import SharedMemoryChannel


class RemoteFlag:
    """Stand in for a callable of the other process; also true if that process has ended.

    The flag is valid during one call. After the call it is true, so that code that still polls it
    ends.
    """

    def __init__(self, index: int) -> None:
        self._index = index
        self._channel: SharedMemoryChannel | None = None

    def __call__(self) -> bool:
        channel = self._channel
        return channel is None or channel.is_raised(self._index) or channel.is_peer_closed()

    @contextlib.contextmanager
    def listening_on(self, channel: SharedMemoryChannel) -> Iterator[None]:
        self._channel = channel
        try:
            yield
        finally:
            self._channel = None


def replace_callable(value: Any, callables: list[Callable[[], Any]]) -> Any:
    """Replace a callable by a flag, and add it to `callables`; return other values unchanged.

    Classes such as np.uint16 count as values, although they can be called.
    """
    if not callable(value) or isinstance(value, type):
        return value
    callables.append(value)
    return RemoteFlag(len(callables) - 1)
