"""The engine's end of the line to the window."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from drivers.hosted.line import Line
from labapp.window.messages import Expose, FrameSeen, Place, Tune

_SUPERSEDED = (Place, Tune, Expose)
"""Commands of which only the newest matters: a turned wheel sends dozens."""

_FRAMES_UNDER_WAY = 2


class Channel:
    """Commands in, reports out, from any thread.

    A thread of its own reads, so that the end of the window and commands that can't wait
    are heard while the engine works. at_once: what is done in that thread, by type of
    command; everything else is put in line. on_end: what is called when the window is gone.
    """

    def __init__(self, line: Line) -> None:
        self._line = line
        self._waiting: deque[Any] = deque()
        self._news = threading.Condition()
        self._room = _FRAMES_UNDER_WAY
        self.closed = False
        self.at_once: Mapping[type, Callable[[Any], None]] = {}
        self.on_end: list[Callable[[], None]] = []
        threading.Thread(target=self._read, name="window", daemon=True).start()

    def send(self, report: object) -> None:
        """Write a report; once the window is gone, nothing."""
        try:
            if not self.closed:
                self._line.send(report)
        except OSError:
            self._close()

    def send_frame(self, frame: object) -> None:
        with self._news:
            self._room -= 1
        self.send(frame)

    @property
    def has_room(self) -> bool:
        """Whether the window has taken in the frames that it was sent."""
        return self._room > 0

    def post(self, command: object) -> None:
        """Put a command in line as if the window had sent it."""
        with self._news:
            if isinstance(command, _SUPERSEDED):
                kept = [c for c in self._waiting if type(c) is not type(command)]
                self._waiting = deque(kept)
            self._waiting.append(command)
            self._news.notify()

    def take(self, patience: float) -> Any:
        """The next command; None if none comes within `patience` seconds."""
        with self._news:
            if not self._waiting and not self.closed:
                self._news.wait(patience)
            return self._waiting.popleft() if self._waiting else None

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._receive(self._line.receive())
        self._close()
        for duty in self.on_end:
            duty()

    def _receive(self, message: object) -> None:
        if isinstance(message, FrameSeen):
            with self._news:
                self._room += 1
                self._news.notify()
        elif type(message) in self.at_once:
            self.at_once[type(message)](message)
        else:
            self.post(message)

    def _close(self) -> None:
        with self._news:
            self.closed = True
            self._news.notify()
