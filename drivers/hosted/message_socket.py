"""Messages between two processes: how all that are started from here talk with each other."""

from __future__ import annotations

import contextlib
import io
import math
import os
import pickle
import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

_LENGTH = struct.Struct("!Q")


_POLL_INTERVAL = 0.02
"""Seconds between looks at what else may happen while a message is waited for."""

_MAX_WAIT = 3600.0
"""Seconds for which the system is asked to wait at once: it counts milliseconds in 32 bits."""


class LineClosed(EOFError):
    """The other end is closed, or its process has ended."""


class MessageTimeout(TimeoutError):
    """No message has come in time."""


class UnreadableMessage(Exception):
    """A message has come, but it can't be unpickled here; the cause says why."""


class MessageSocket:
    """One end of a socket for messages: a length, then the pickled object. Never None.

    Both ends are our own processes. Any thread may send, and one at a time may receive.
    Where the other end is closed, receiving raises LineClosed and sending an OSError. memory:
    descriptor of memory that both ends can map, for what is large or in a hurry.
    """

    def __init__(self, end: int, memory: int = -1) -> None:
        self.memory = memory
        self._socket = socket.socket(fileno=end)
        self._sending = threading.Lock()
        self._part = bytearray(_LENGTH.size)
        self._read = 0
        self._is_length = True

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()
        memory, self.memory = self.memory, -1
        if memory >= 0:
            os.close(memory)

    def disconnect(self) -> None:
        """Say no more, and let who waits here for a message know: LineClosed. From any thread."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    # A pyusb backend, for one, is never told that nobody needs it any more.
    __del__ = close

    def send(self, message: object) -> None:
        """Wait for as long as the other end doesn't read. What can't be pickled isn't sent."""
        # In one piece, so that who waits for it wakes only once.
        whole = io.BytesIO(bytes(_LENGTH.size))
        whole.seek(_LENGTH.size)
        pickle.dump(message, whole, protocol=5)
        with whole.getbuffer() as data, self._sending:
            _LENGTH.pack_into(data, 0, len(data) - _LENGTH.size)
            self._socket.sendall(data)

    def receive_nowait(self) -> Any:
        """The next message; None if it hasn't come yet, or not all of it. Never waits.

        What comes after it is not touched: while there is some, the socket can be read.
        """
        try:
            while self._read < len(self._part):
                with memoryview(self._part) as part:
                    count = self._socket.recv_into(part[self._read :], 0, socket.MSG_DONTWAIT)
                if not count:
                    raise LineClosed
                self._read += count
                if self._is_length and self._read == len(self._part):
                    self._begin(*_LENGTH.unpack(self._part), is_length=False)
        except BlockingIOError:
            return None
        except OSError as error:
            # Such as ECONNRESET: it was closed before it had read everything.
            raise LineClosed from error
        body = self._part
        self._begin(_LENGTH.size, is_length=True)
        try:
            return pickle.loads(body)
        except Exception as error:
            raise UnreadableMessage(repr(error)) from error

    def receive(
        self,
        timeout: float = math.inf,
        on_poll: Callable[[], None] | None = None,
        exit_descriptor: int | None = None,
    ) -> Any:
        """The next message. MessageTimeout if there is none within so many seconds; or LineClosed.

        on_poll: called every 20 ms meanwhile; what it raises comes from here. exit_descriptor:
        descriptor that can be read once the other process has ended, though one of its own
        processes may still hold the socket open.
        """
        late = time.monotonic() + timeout
        either = select.poll()
        for end in (
            (self.fileno(),) if exit_descriptor is None else (self.fileno(), exit_descriptor)
        ):
            either.register(end, select.POLLIN)
        while True:
            if on_poll is not None:
                on_poll()
            left = max(0.0, late - time.monotonic())
            patience = min(left, _MAX_WAIT if on_poll is None else _POLL_INTERVAL)
            ready = dict(either.poll(math.ceil(patience * 1e3)))
            if ready and (message := self.receive_nowait()) is not None:
                return message
            if exit_descriptor in ready:
                raise LineClosed
            if time.monotonic() >= late:
                raise MessageTimeout(f"no message within {timeout:g} s")

    def _begin(self, size: int, *, is_length: bool) -> None:
        self._part, self._read, self._is_length = bytearray(size), 0, is_length


def hang_up_poll(end: int) -> select.poll:
    """What tells that the other end of a socket has been closed, and nothing else."""
    closed = select.poll()
    closed.register(end, select.POLLRDHUP)
    return closed
