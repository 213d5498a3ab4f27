"""X servers of our own, asked by the tools that come with X: xwd, xrandr and the like."""

from __future__ import annotations

import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from drivers.hosted.child_process import terminate_or_kill
from simulator.screens.xwd import pixels_of

_PATIENCE = 60.0
"""Seconds in which a tool must have answered, on a computer that has other things to do."""

_STARTING = 30.0
"""Seconds in which a server must be there, and in which it must have gone."""


class NoXServer(OSError):
    """A server can't be started; why, and what helps, in words."""


class XServer:
    """A display that is up. process: the server's number."""

    def __init__(self, display: str, process: int) -> None:
        self.display, self.process = display, process

    def run(self, *command: str, stdin: str = "") -> str:
        """What a tool prints when it is given these words.

        OSError if it isn't installed, subprocess.SubprocessError if it fails.
        """
        done = subprocess.run(
            command,
            input=stdin,
            env=self._environment(),
            capture_output=True,
            text=True,
            timeout=_PATIENCE,
            check=True,
        )
        return done.stdout

    def xrandr(self, words: str) -> str:
        return self.run("xrandr", *words.split())

    def pixels(self) -> NDArray[np.uint8]:
        """The whole screen as xwd sees it: (rows, columns, 3), blue, green, red.

        OSError if xwd isn't installed, or sees nothing.
        """
        command = ["xwd", "-display", self.display, "-root", "-silent"]
        late = time.monotonic() + _PATIENCE
        while time.monotonic() < late:
            done = subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=False)
            if done.stdout:  # it fails when a window goes while it looks
                return pixels_of(done.stdout)
        raise OSError(f"xwd sees nothing on {self.display}: {done.stderr.decode()!r}")

    @contextmanager
    def program(self, *command: str) -> Iterator[subprocess.Popen[bytes]]:
        """A program on this display while the block lasts."""
        process = subprocess.Popen(
            command,
            env=self._environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            yield process
        finally:
            terminate_or_kill(process, _STARTING)

    def _environment(self) -> dict[str, str]:
        return {**os.environ, "DISPLAY": self.display}


@contextmanager
def running_server(command: list[str]) -> Iterator[XServer]:
    """A server of a free number while the block lasts. NoXServer if it doesn't start."""
    # Whatever ends this process, or the thread that begins the block, ends the server.
    guard = ["setpriv", "--pdeathsig", "KILL", "--"] if shutil.which("setpriv") else []
    reading, writing = os.pipe()
    with os.fdopen(reading) as told:
        try:
            server = subprocess.Popen(
                [*guard, *command, "-displayfd", str(writing), "-nolisten", "tcp", "-noreset"],
                pass_fds=[writing],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                # Ctrl-C is for this process, which ends it last.
                start_new_session=True,
            )
        finally:
            os.close(writing)
        try:
            # It tells its number once it listens, or ends without a word.
            ready, _, _ = select.select([told], [], [], _STARTING)
            number = told.readline().strip() if ready else ""
            if not number:
                program = os.path.basename(command[0])
                raise NoXServer(f"{program} didn't start. Try it by hand: {program} -displayfd 1")
            yield XServer(f":{number}", server.pid)
        finally:
            terminate_or_kill(server, _STARTING)


@contextmanager
def xvfb(columns: int, rows: int, display: str = "") -> Iterator[XServer]:
    """One screen of 24 bits that is scanned out nowhere.

    display: such as ":1"; one that is free if empty. NoXServer if it can't be had.
    """
    program = require_program("Xvfb", "xvfb")
    number = [display] if display else []
    with running_server([program, *number, "-screen", "0", f"{columns}x{rows}x24"]) as server:
        yield server


def require_program(name: str, packages: str) -> str:
    """Where a program is. NoXServer names the packages to install if it isn't there."""
    found = shutil.which(name)
    if found is None:
        raise NoXServer(f"{name} isn't installed: sudo apt-get install {packages}")
    return found
