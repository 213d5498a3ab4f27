"""A line behind a pseudo-terminal: any program of this computer can open it as a serial port."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import tty
from pathlib import Path
from typing import Self

from drivers.clock import RealClock
from drivers.interfaces import Clock
from simulator.wire.line import SimulatedLine

_POLL_INTERVAL = 0.02
"""Seconds between looks at whether a plug was pulled or serving shall end."""


class PtyLine:
    """A line that is served, in a thread of its own, at a path that stays the same.

    line: what is served. path: a symbolic link to the terminal; while the plug is out it isn't
    there, and who holds the terminal is hung up. clock: the bench's; it must go like the
    wall's. A context manager; only where the system has pseudo-terminals.
    """

    def __init__(self, line: SimulatedLine, path: Path, clock: Clock | None = None) -> None:
        self.line, self.path = line, path
        self.clock: Clock = clock or RealClock()
        self._ends: tuple[int, int] | None = None
        self._pulls = 0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"wire {path.name}", daemon=True)

    def __enter__(self) -> Self:
        self._plug_in()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopping.set()
        self._thread.join()
        self._unplug()

    def _serve(self) -> None:
        while not self._stopping.is_set():
            now = self.clock.now()
            pulls = self.line.unplug_count(now)
            if self._ends and (self.line.is_unplugged(now) or pulls > self._pulls):
                self._unplug()
            if self._ends is None:
                if self.line.is_unplugged(now):
                    self._stopping.wait(_POLL_INTERVAL)
                    continue
                self._plug_in()
            self._transfer(now)

    def _transfer(self, now: float) -> None:
        """Carry bytes both ways, and wait until there may be more."""
        if self._ends is None:
            return
        near = self._ends[0]
        data = self.line.receive(now)
        # Who doesn't listen misses it, as at a real port whose buffer is full.
        with contextlib.suppress(BlockingIOError):
            while data:
                data = data[os.write(near, data) :]
        then = min(self.line.next_event_time() - now, _POLL_INTERVAL)
        if select.select([near], [], [], max(then, 0.0))[0]:
            self.line.send(os.read(near, 4096), self.clock.now())

    def _plug_in(self) -> None:
        self._ends = near, far = os.openpty()
        # The far end stays open here, so that the near one lives without a listener.
        tty.setraw(far)
        os.set_blocking(near, False)
        self._pulls = self.line.unplug_count(self.clock.now())
        aside = self.path.with_name(self.path.name + ".new")
        aside.unlink(missing_ok=True)
        aside.symlink_to(os.ttyname(far))
        aside.replace(self.path)

    def _unplug(self) -> None:
        if self._ends is None:
            return
        ends, self._ends = self._ends, None
        self.path.unlink(missing_ok=True)
        self.line.receive(self.clock.now())
        for end in ends:
            os.close(end)
