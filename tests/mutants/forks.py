"""Runs pytest in a fork of this process, which has the libraries in memory."""

from __future__ import annotations

import contextlib
import importlib
import os
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

OVERLAY = Path(__file__).with_name("overlay")
TICK = 0.01
"""Seconds between looks at whether a fork has ended."""


@dataclass(frozen=True)
class Ended:
    code: int | None
    """None: it ran past its time and was killed."""
    seconds: float
    output: str


def in_a_fork(work: Callable[[Path], int], environment: dict[str, str], limit: float) -> Ended:
    """What becomes of work(folder): in a process group and an empty folder of its own."""
    folder = Path(tempfile.mkdtemp(prefix="mutant-"))
    began = time.monotonic()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        _be_the_fork(work, folder, environment)
    try:
        code = _end(child, began + limit)
        output = (folder / "output").read_text(errors="replace")
    finally:
        _kill_group(child)
        shutil.rmtree(folder, ignore_errors=True)
    return Ended(code, time.monotonic() - began, output)


def _be_the_fork(work: Callable[[Path], int], folder: Path, environment: dict[str, str]) -> None:
    code = 70
    try:
        os.setsid()
        out = os.open(folder / "output", os.O_WRONLY | os.O_CREAT)
        for stream, file in ((0, os.open(os.devnull, os.O_RDONLY)), (1, out), (2, out)):
            os.dup2(file, stream)
        known = os.environ.get("PYTHONPATH")
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(OVERLAY), known]))
        os.environ.update(environment)
        code = int(work(folder))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        # Not sys.exit: what the parent has registered for its own end isn't the fork's to do.
        os._exit(code)


def _end(child: int, latest: float) -> int | None:
    while time.monotonic() < latest:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(TICK)
    _kill_group(child)
    os.waitpid(child, 0)
    return None


def _kill_group(leader: int) -> None:
    """Also what a test has left behind."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)


def load(names: list[str]) -> None:
    """Import libraries here, once, instead of in every fork."""
    for name in names:
        with contextlib.suppress(Exception):
            importlib.import_module(name)
