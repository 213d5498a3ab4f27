"""Pickle objects for the transfer between a process and its child."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import Any, NamedTuple


class Parcel(NamedTuple):
    """A pickled object with its large arrays apart, so that they are copied only once."""

    body: Any
    buffers: Sequence[Any]

    def unpack(self) -> Any:
        return pickle.loads(self.body, buffers=self.buffers)


def pack(thing: Any) -> Parcel:
    """Pickle an object, with its large arrays apart."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
    return Parcel(body, [buffer.raw() for buffer in buffers])
