"""X servers that this process starts, and their inspection by X's own tools, xwd and xrandr."""

from __future__ import annotations

import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.hosted.child_process import terminate_or_kill
from simulator.screens.authority import authority_file, published_cookie, server_cookie
from simulator.screens.xwd import pixels_of


@dataclass(frozen=True)
class XServerSettings:
    """Limit how long X servers and X's tools may take.

    Attributes
    ----------
    tool_timeout : float
        Seconds within which a tool must answer, also on a busy computer. Chosen.
    start_timeout : float
        Seconds within which a server must be up, and within which a program must end. Chosen.
    start_tries : int
        Most times that a server is started. Chosen.
    """

    tool_timeout: float = 60.0
    start_timeout: float = 30.0
    start_tries: int = 3


SETTINGS = XServerSettings()


class NoXServer(OSError):
    """An X server can't be started; the message says why, and what helps."""


class XServer:
    """Run X's tools on the display of a running X server.

    Parameters
    ----------
    display : str
        The server's display, such as ":1".
    process : int
        The server's process id.
    """

    def __init__(self, display: str, process: int) -> None:
        self.display, self.process = display, process

    def run(self, *command: str, stdin: str = "") -> str:
        """Run an X tool on the virtual screen and return what it prints.

        Raises OSError if the tool isn't installed, and subprocess.SubprocessError if it fails.
        """
        done = subprocess.run(
            command,
            input=stdin,
            env=self._environment(),
            capture_output=True,
            text=True,
            timeout=SETTINGS.tool_timeout,
            check=True,
        )
        return done.stdout

    def xrandr(self, words: str) -> str:
        """Run xrandr on the virtual screen with these arguments and return what it prints."""
        return self.run("xrandr", *words.split())

    def pixels(self) -> NDArray[np.uint8]:
        """Return the whole virtual screen as xwd reads it: (rows, columns, 3) of blue, green, red.

        Raises OSError if xwd isn't installed, or returns no picture.
        """
        command = ["xwd", "-display", self.display, "-root", "-silent"]
        late = time.monotonic() + SETTINGS.tool_timeout
        while time.monotonic() < late:
            done = subprocess.run(
                command, capture_output=True, timeout=SETTINGS.tool_timeout, check=False
            )
            if done.stdout:  # xwd fails if a window closes meanwhile: try again
                return pixels_of(done.stdout)
        raise OSError(f"xwd sees nothing on {self.display}: {done.stderr.decode()!r}")

    @contextmanager
    def program(self, *command: str) -> Iterator[subprocess.Popen[bytes]]:
        """Run a program on the virtual screen while the block lasts."""
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
            terminate_or_kill(process, SETTINGS.start_timeout)

    def _environment(self) -> dict[str, str]:
        """Return the environment variables with which a program finds the virtual screen."""
        return {**os.environ, "DISPLAY": self.display}


@contextmanager
def running_server(command: list[str]) -> Iterator[XServer]:
    """Run an X server with virtual screens on a free display while the block lasts.

    Only programs of this user can use it: they find its cookie in the user's authority file.

    Parameters
    ----------
    command : list of str
        The server's program and its arguments.

    Yields
    ------
    XServer
        The running server.

    Raises
    ------
    NoXServer
        If the server doesn't start.
    """
    with server_cookie(Path(tempfile.gettempdir())) as (file, cookie):
        server, number = _start_server([*command, "-auth", str(file)])
        try:
            with _publish_cookie(f":{number}", cookie):
                yield XServer(f":{number}", server.pid)
        finally:
            terminate_or_kill(server, SETTINGS.start_timeout)


def _start_server(command: list[str]) -> tuple[subprocess.Popen[bytes], str]:
    """Start an X server; return its process, and the number of its display once it listens.

    A server that starts at the same moment may take the display that this one has found free, so
    that it ends; then it is tried again.
    """
    # setpriv lets the kernel end the server when this process, or the thread that starts the
    # block, ends.
    guard = ["setpriv", "--pdeathsig", "KILL", "--"] if shutil.which("setpriv") else []
    for _ in range(SETTINGS.start_tries):
        reading, writing = os.pipe()
        with os.fdopen(reading) as told:
            options = ["-displayfd", str(writing), "-nolisten", "tcp", "-noreset"]
            try:
                server = subprocess.Popen(
                    [*guard, *command, *options],
                    pass_fds=[writing],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    # Ctrl-C must reach this process only, which ends the server last.
                    start_new_session=True,
                )
            finally:
                os.close(writing)
            number, ready = "", False
            try:
                # The server writes its display number, or ends without writing.
                ready = bool(select.select([told], [], [], SETTINGS.start_timeout)[0])
                number = told.readline().strip() if ready else ""
            finally:
                if not number:
                    terminate_or_kill(server, SETTINGS.start_timeout)
        if number:
            return server, number
        if not ready:
            break
    program = os.path.basename(command[0])
    raise NoXServer(f"{program} didn't start. Try it by hand: {program} -displayfd 1")


@contextmanager
def _publish_cookie(display: str, cookie: bytes) -> Iterator[None]:
    """Let this user's programs use an X server while the block lasts; NoXServer if that fails."""
    with ExitStack() as stack:
        try:
            stack.enter_context(published_cookie(display, cookie))
        except OSError as error:
            raise NoXServer(
                f"its cookie can't be kept in {authority_file()}: {error.strerror}. Let XAUTHORITY "
                "name a file that you may write"
            ) from error
        yield


@contextmanager
def xvfb(columns: int, rows: int, display: str = "") -> Iterator[XServer]:
    """Run an X server with one invisible virtual screen of 24 bits while the block lasts.

    Parameters
    ----------
    columns, rows : int
        Size of the screen in pixels.
    display : str, default ""
        The display, such as ":1"; a free one if empty.

    Yields
    ------
    XServer
        The running server.

    Raises
    ------
    NoXServer
        If Xvfb isn't installed or doesn't start.
    """
    program = require_program("Xvfb", "xvfb")
    number = [display] if display else []
    with running_server([program, *number, "-screen", "0", f"{columns}x{rows}x24"]) as server:
        yield server


def require_program(name: str, packages: str) -> str:
    """Return the path of an installed program that a virtual screen's X server needs.

    Parameters
    ----------
    name : str
        The program's name.
    packages : str
        The Debian packages that contain it, for the error message.

    Returns
    -------
    str
        The program's path.

    Raises
    ------
    NoXServer
        If the program isn't installed; the message names the packages.
    """
    found = shutil.which(name)
    if found is None:
        raise NoXServer(f"{name} isn't installed: sudo apt-get install {packages}")
    return found
