"""Objects on their way from one process to another."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import Any, NamedTuple


class Parcel(NamedTuple):
    """A pickled object; its large arrays lie beside it, so that they are copied only once."""

    body: Any
    buffers: Sequence[Any]

    def unpack(self) -> Any:
        return pickle.loads(self.body, buffers=self.buffers)


def pack(thing: Any) -> Parcel:
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
    return Parcel(body, [buffer.raw() for buffer in buffers])
