"""Messages between two processes: how all that are started from here talk with each other."""

from __future__ import annotations

import pickle
import select
import socket
import struct
import threading
import time
from multiprocessing.connection import wait
from typing import Any

_LENGTH = struct.Struct("!Q")


class Unreadable(Exception):
    """A message has come, but it can't be unpickled here; the cause says why."""


class Line:
    """One end of a socket for messages: a length, then the pickled object. Never None.

    Both ends are our own processes. Any thread may send, and one at a time may receive.
    Where the other end is closed, receiving raises EOFError and sending an OSError.
    """

    def __init__(self, end: int) -> None:
        self._socket = socket.socket(fileno=end)
        self._sending = threading.Lock()
        self._unsent = bytearray()
        self._await_length()

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()

    # A pyusb backend, for one, is never told that nobody needs it any more.
    __del__ = close

    def send(self, message: object) -> None:
        """Wait for as long as the other end doesn't read. What can't be pickled isn't sent."""
        body = pickle.dumps(message, protocol=5)
        with self._sending:
            self._socket.sendall(_LENGTH.pack(len(body)))
            self._socket.sendall(body)

    def post(self, message: object) -> bool:
        """Send and never wait; see `flush` for what it gives back. Not to be mixed with `send`."""
        body = pickle.dumps(message, protocol=5)
        self._unsent += _LENGTH.pack(len(body)) + body
        return self.flush()

    def flush(self) -> bool:
        """Send what was posted, as far as there is room for it; whether nothing is left."""
        try:
            while self._unsent:
                del self._unsent[: self._socket.send(self._unsent, socket.MSG_DONTWAIT)]
        except BlockingIOError:
            return False
        return True

    def take(self) -> Any:
        """The next message; None if it hasn't come yet, or not all of it. Never waits.

        What comes after it is not touched: while there is some, the socket can be read.
        """
        try:
            while self._read < len(self._part):
                with memoryview(self._part) as part:
                    count = self._socket.recv_into(part[self._read :], 0, socket.MSG_DONTWAIT)
                if not count:
                    raise EOFError("the other end is closed")
                self._read += count
                if self._is_length and self._read == len(self._part):
                    (length,) = _LENGTH.unpack(self._part)
                    self._part, self._read, self._is_length = bytearray(length), 0, False
        except BlockingIOError:
            return None
        except ConnectionResetError as error:
            # It was closed before it had read everything.
            raise EOFError("the other end is closed") from error
        body = self._part
        self._await_length()
        try:
            return pickle.loads(body)
        except Exception as error:
            raise Unreadable(repr(error)) from error

    def receive(self, patience: float | None = None) -> Any:
        """The next message, waited for. TimeoutError if it takes longer than so many seconds."""
        late = None if patience is None else time.monotonic() + patience
        while (message := self.take()) is None:
            left = None if late is None else late - time.monotonic()
            if not wait([self._socket], left) and left is not None and left <= 0:
                raise TimeoutError(f"no message within {patience:g} s")
        return message

    def _await_length(self) -> None:
        self._part, self._read, self._is_length = bytearray(_LENGTH.size), 0, True


def hang_up(end: int) -> select.poll:
    """What tells that the other end of a socket has been closed, and nothing else."""
    closed = select.poll()
    closed.register(end, select.POLLRDHUP)
    return closed
