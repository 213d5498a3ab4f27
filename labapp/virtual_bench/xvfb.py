"""An X server without a screen that anybody sees."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from labapp.errors import UserError

_ENDING = 30.0
"""Seconds in which it must have ended."""


@contextmanager
def xvfb(rows: int, columns: int, display: str = "") -> Iterator[str]:
    """Its display, such as ":1", while the block lasts; one that is free if none is given.

    It ends with the thread that has begun the block, too. UserError if there is no such server,
    or it doesn't start.
    """
    program = shutil.which("Xvfb")
    if program is None:
        raise UserError(
            "the SLM needs a screen. Install a virtual one: sudo apt-get install xvfb. Or name a "
            "real one with --display and --screen, or leave the SLM out with --slm none."
        )
    # Whatever ends this process, or this thread, ends the server.
    guard = ["setpriv", "--pdeathsig", "KILL", "--"] if shutil.which("setpriv") else []
    reading, writing = os.pipe()
    size = f"{columns}x{rows}x24"
    command = [*guard, program, *filter(None, [display]), "-displayfd", str(writing)]
    server = subprocess.Popen(
        [*command, "-screen", "0", size, "-nolisten", "tcp", "-noreset"],
        pass_fds=[writing],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # Ctrl-C is for this process, which ends it last.
        start_new_session=True,
    )
    os.close(writing)
    try:
        with os.fdopen(reading) as told:
            number = told.readline().strip()
        if not number:
            raise UserError("Xvfb didn't start. Try it by hand: Xvfb -displayfd 1")
        yield f":{number}"
    finally:
        _end(server)


def _end(server: subprocess.Popen[bytes]) -> None:
    server.terminate()
    try:
        server.wait(_ENDING)
    except subprocess.TimeoutExpired:
        server.kill()
        server.wait()
