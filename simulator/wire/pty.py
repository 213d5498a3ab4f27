"""A pseudo-terminal before a simulated line, which any local program can open as a serial port."""

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

# Seconds between checks whether the cable was unplugged or the thread must end.
_POLL_INTERVAL = 0.02


class PtyLine:
    """Serve a simulated line as a pseudo-terminal at a constant path, in a thread of its own.

    path: a symbolic link to the terminal. While the cable is unplugged there is no link, and a
    program that holds the terminal gets a hang-up. clock: must run at the speed of real time. The
    object is a context manager; it needs a system with pseudo-terminals.
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
            unplugged = self.line.is_unplugged(now)
            if unplugged or self.line.unplug_count(now) > self._pulls:
                self._unplug()
            if unplugged:
                self._stopping.wait(_POLL_INTERVAL)
                continue
            near = self._ends[0] if self._ends else self._plug_in()
            self._transfer(near, now)

    def _transfer(self, near: int, now: float) -> None:
        """Transfer bytes between the pseudo-terminal and the line, and wait for more."""
        data = self.line.receive(now)
        # Bytes that nobody reads are lost, as at a real port whose buffer is full.
        with contextlib.suppress(BlockingIOError):
            while data:
                data = data[os.write(near, data) :]
        then = min(self.line.next_event_time() - now, _POLL_INTERVAL)
        if select.select([near], [], [], max(then, 0.0))[0]:
            self.line.send(os.read(near, 4096), self.clock.now())

    def _plug_in(self) -> int:
        """Make the pseudo-terminal, and return its near end."""
        self._ends = near, far = os.openpty()
        # The far end stays open here, because the near end is unusable without an open far end.
        tty.setraw(far)
        os.set_blocking(near, False)
        self._pulls = self.line.unplug_count(self.clock.now())
        aside = self.path.with_name(self.path.name + ".new")
        aside.unlink(missing_ok=True)
        aside.symlink_to(os.ttyname(far))
        aside.replace(self.path)
        return near

    def _unplug(self) -> None:
        if self._ends is None:
            return
        ends, self._ends = self._ends, None
        self.path.unlink(missing_ok=True)
        self.line.receive(self.clock.now())
        for end in ends:
            os.close(end)
