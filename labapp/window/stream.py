"""Messages on a stream of bytes: a length, then the pickled message.

Both ends are this application's own processes. The reader takes whatever bytes have come
and never waits for the rest, so that an engine that hangs in mid-message can't hang the
window.
"""

from __future__ import annotations

import pickle
import struct
from typing import Any

_LENGTH = struct.Struct("!Q")


def pack(message: object) -> bytes:
    body = pickle.dumps(message, protocol=5)
    return _LENGTH.pack(len(body)) + body


class Unpacker:
    """Bytes in, whole messages out; an incomplete message waits for its rest."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Any]:
        self._buffer += data
        messages = []
        while (message := self._next()) is not None:
            messages.append(message)
        return messages

    def _next(self) -> Any:
        if len(self._buffer) < _LENGTH.size:
            return None
        (length,) = _LENGTH.unpack_from(self._buffer)
        end = _LENGTH.size + length
        if len(self._buffer) < end:
            return None
        with memoryview(self._buffer) as whole, whole[_LENGTH.size : end] as body:
            message = pickle.loads(body)
        del self._buffer[:end]
        return message
