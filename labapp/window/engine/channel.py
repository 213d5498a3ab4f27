"""The engine's end of the line to the window."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from drivers.hosted.message_socket import MessageSocket
from labapp.window.messages import AcknowledgeFrame, PlaceTarget, SetExposure, SetWavelength

_NEWEST_ONLY = (PlaceTarget, SetWavelength, SetExposure)
"""Commands of which only the newest matters: a turned wheel sends dozens."""

_MAX_FRAMES_IN_FLIGHT = 2


class Channel:
    """Commands in, reports out, from any thread.

    A thread of its own reads, so that the end of the window and commands that can't wait
    are heard while the engine works. immediate_handlers: what is done in that thread, by type of
    command; everything else is put in line. end_handlers: what is called when the window is gone.
    """

    def __init__(self, line: MessageSocket) -> None:
        self._line = line
        self._waiting: deque[Any] = deque()
        self._condition = threading.Condition()
        self._room = _MAX_FRAMES_IN_FLIGHT
        self.closed = False
        self.immediate_handlers: Mapping[type, Callable[[Any], None]] = {}
        self.end_handlers: list[Callable[[], None]] = []
        threading.Thread(target=self._read, name="window", daemon=True).start()

    def send(self, report: object) -> None:
        """Write a report; once the window is gone, nothing."""
        try:
            if not self.closed:
                self._line.send(report)
        except OSError:
            self._close()

    def send_frame(self, frame: object) -> None:
        with self._condition:
            self._room -= 1
        self.send(frame)

    @property
    def has_room(self) -> bool:
        """Whether the window has taken in the frames that it was sent."""
        return self._room > 0

    def post(self, command: object) -> None:
        """Put a command in line as if the window had sent it."""
        with self._condition:
            if isinstance(command, _NEWEST_ONLY):
                kept = [c for c in self._waiting if type(c) is not type(command)]
                self._waiting = deque(kept)
            self._waiting.append(command)
            self._condition.notify()

    def take_command(self, timeout: float) -> Any:
        """The next command; None if none comes within `timeout` seconds."""
        with self._condition:
            if not self._waiting and not self.closed:
                self._condition.wait(timeout)
            return self._waiting.popleft() if self._waiting else None

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._receive(self._line.receive())
        self._close()
        for duty in self.end_handlers:
            duty()

    def _receive(self, message: object) -> None:
        if isinstance(message, AcknowledgeFrame):
            with self._condition:
                self._room += 1
                self._condition.notify()
        elif type(message) in self.immediate_handlers:
            self.immediate_handlers[type(message)](message)
        else:
            self.post(message)

    def _close(self) -> None:
        with self._condition:
            self.closed = True
            self._condition.notify()
