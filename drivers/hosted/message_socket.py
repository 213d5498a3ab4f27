"""Sockets for messages between a process and its child processes."""

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

_PART_BYTES = 1 << 20
"""Bytes of a message that are read without a pause. Chosen: a millisecond or two."""


class LineClosed(EOFError):
    """Raised when the other end is closed, or its process has ended."""


class MessageTimeout(TimeoutError):
    """Raised when no message has come in time."""


class UnreadableMessage(Exception):
    """Raised for a message that can't be unpickled in this process; the cause says why."""


class MessageSocket:
    """One end of a socket between processes; a message is a length and then a pickled object.

    A message is never None. Both ends are processes of this application. Any thread may send, but
    only one at a time may receive. If the other end is closed, receiving raises LineClosed and
    sending an OSError. memory: descriptor of memory that both ends can map, for data that are large
    or urgent.
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
        """Shut down the socket.

        A thread that waits in `receive` gets LineClosed. Any thread may call this method.
        """
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    # Some owners can't call close(): pyusb, for example, doesn't tell a backend when it is unused.
    __del__ = close

    def send(self, message: object) -> None:
        """Send a message, and wait until the other process reads it.

        An exception is raised if the message can't be pickled.
        """
        # Length and object are sent in one piece, so that the receiver wakes up only once.
        whole = io.BytesIO(bytes(_LENGTH.size))
        whole.seek(_LENGTH.size)
        pickle.dump(message, whole, protocol=5)
        with whole.getbuffer() as data, self._sending:
            _LENGTH.pack_into(data, 0, len(data) - _LENGTH.size)
            self._socket.sendall(data)

    def receive_nowait(self) -> Any:
        """Return the next message, or None if it hasn't arrived completely or is large.

        A large one is read in parts, one a call, so that who polls the socket can do something else
        in between. Bytes of later messages stay in the socket, so that it can still be polled for
        them.
        """
        try:
            most = self._read + _PART_BYTES
            while self._read < len(self._part):
                if self._read >= most:
                    return None
                with memoryview(self._part) as part:
                    count = self._socket.recv_into(part[self._read : most], 0, socket.MSG_DONTWAIT)
                if not count:
                    raise LineClosed
                self._read += count
                if self._is_length and self._read == len(self._part):
                    self._begin(*_LENGTH.unpack(self._part), is_length=False)
        except BlockingIOError:
            return None
        except OSError as error:
            # ECONNRESET, for example, means that the other end was closed with unread data.
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
        """Wait for the next message, and return it.

        MessageTimeout is raised after the timeout, and LineClosed if the other end is closed.

        timeout: seconds. on_poll: called every 20 ms meanwhile; its exceptions pass through.
        exit_descriptor: descriptor that becomes readable when the other process has ended, even if
        one of that process's own children holds the socket open.
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
            # The system counts a wait in milliseconds in 32 bits, so it is limited to an hour.
            patience = min(left, 3600.0 if on_poll is None else 0.02)
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
    """Return a poll object that reports only that the other process closed its socket."""
    closed = select.poll()
    closed.register(end, select.POLLRDHUP)
    return closed
