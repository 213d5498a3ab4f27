"""The engine's end of its connection to the window."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any

from drivers.hosted.message_socket import MessageSocket
from labapp.window.commands import PlaceTarget, SetExposure, SetWavelength

_NEWEST_ONLY = (PlaceTarget, SetWavelength, SetExposure)
"""Commands of which only the newest is kept: a turn of the mouse wheel sends dozens of them."""


class Channel:
    """Receive commands from the window and send reports to it, from any thread.

    A thread of its own reads, so that the engine receives urgent commands, and notices the end of
    the window, while it works. `immediate_handlers` are called in that thread, by type of command;
    all other commands wait for take_command(). `on_received` is called in that thread with every
    command once it is handled or waits. `end_handlers` are called when the window is gone.
    """

    def __init__(self, line: MessageSocket) -> None:
        self._line = line
        self._waiting: deque[Any] = deque()
        self._condition = threading.Condition()
        self.closed = False
        self.immediate_handlers: Mapping[type, Callable[[Any], None]] = {}
        self.on_received: Callable[[object], None] = lambda _: None
        self.end_handlers: list[Callable[[], None]] = []
        threading.Thread(target=self._read, name="window", daemon=True).start()

    def send(self, report: object) -> None:
        """Send a report; do nothing once the window is gone."""
        try:
            if not self.closed:
                self._line.send(report)
        except OSError:
            self._close()

    def wake(self) -> None:
        """Let take_command() return, though there may be no command."""
        with self._condition:
            self._condition.notify()

    @property
    def has_commands(self) -> bool:
        """Return whether commands wait to be taken."""
        return bool(self._waiting)

    @property
    def memory(self) -> int:
        """Return the descriptor of the memory that both processes share."""
        return self._line.memory

    def post(self, command: object) -> None:
        """Queue a command as if the window had sent it."""
        with self._condition:
            if isinstance(command, _NEWEST_ONLY):
                kept = [c for c in self._waiting if type(c) is not type(command)]
                self._waiting = deque(kept)
            self._waiting.append(command)
            self._condition.notify()

    def take_command(self, timeout: float) -> Any:
        """Return the next command; None if none comes within `timeout` seconds."""
        with self._condition:
            if not self._waiting and not self.closed:
                self._condition.wait(timeout)
            return self._waiting.popleft() if self._waiting else None

    def take_command_of(self, kinds: Collection[type], timeout: float) -> Any:
        """Take a command of these kinds within `timeout` s, else None; others keep their order."""
        with self._condition:
            if not self._is_waiting(kinds) and not self.closed:
                self._condition.wait_for(lambda: self.closed or self._is_waiting(kinds), timeout)
            found = next((one for one in self._waiting if type(one) in kinds), None)
            if found is not None:
                # By identity, since commands that are equal may be waiting.
                self._waiting = deque(one for one in self._waiting if one is not found)
            return found

    def _is_waiting(self, kinds: Collection[type]) -> bool:
        return any(type(one) in kinds for one in self._waiting)

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._receive(self._line.receive())
        self._close()
        for duty in self.end_handlers:
            duty()

    def _receive(self, message: object) -> None:
        if type(message) in self.immediate_handlers:
            self.immediate_handlers[type(message)](message)
        else:
            self.post(message)
        self.on_received(message)

    def _close(self) -> None:
        with self._condition:
            self.closed = True
            self._condition.notify()
