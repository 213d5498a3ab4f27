"""What takes a callable's place in the other process."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from drivers.hosted.shared_memory_channel import SharedMemoryChannel


class RemoteFlag:
    """Stands for a callable of the other process; true as well when that is gone.

    Its word holds for one call: afterwards it is true, so that whoever still asks may go.
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
    """A flag in place of a callable. A class is a value: np.uint16 isn't asked anything."""
    if not callable(value) or isinstance(value, type):
        return value
    callables.append(value)
    return RemoteFlag(len(callables) - 1)
