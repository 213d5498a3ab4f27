"""The process that the others are forked from: it has loaded what they would load.

    python server.py SOCKET MODULE ...

For every request it forks a process whose parent becomes the one that asked, so that this one
can wait for it as for any child. It has one thread, and ends when the other end of its socket is
closed. A forked process comes back from `serve`, becomes what was asked for, and ends as any
Python program does, but that its modules aren't taken down one by one.
"""

from __future__ import annotations

import atexit
import ctypes
import fcntl
import gc
import importlib
import json
import os
import runpy
import signal
import socket
import sys
import tempfile
import types
from itertools import pairwise
from typing import Any

LIMIT = 1 << 20
"""Bytes of the longest request."""

_SET_PDEATHSIG = 1
"""Of prctl(2); from linux/prctl.h."""

_FIRST = 1000
"""File descriptors from here on are free while others are given their numbers."""


def serve(line: socket.socket) -> tuple[dict[str, Any], list[int]]:
    """Fork for every request; returns in the forked process: the request and its open files."""
    while True:
        data, files, _, _ = socket.recv_fds(line, LIMIT, 100)
        if not data:
            os._exit(0)
        request = json.loads(data)
        numbers, reply = os.pipe()
        waiting, go = os.pipe()
        between = os.fork()
        if not between:
            process = os.fork()
            if not process:
                line.close()
                os.close(go)
                os.read(waiting, 1)
                return request, files
            os.write(reply, str(process).encode())
            os._exit(0)
        os.waitpid(between, 0)
        # Only now has it its new parent.
        line.send(os.read(numbers, 100))
        for file in (numbers, reply, waiting, go, *files):
            os.close(file)


def become(request: dict[str, Any], files: list[int]) -> None:
    """Make this process the one that was asked for, but for its program."""
    # Nobody else would end it where those who run the tests are killed.
    ctypes.CDLL(None).prctl(_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != request["parent"]:
        os._exit(1)
    _take_files(request["files"], files)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # After nohup all processes would ignore it.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    # This server may have been started while signals were blocked.
    signal.pthread_sigmask(signal.SIG_SETMASK, request["blocked"])
    if request["session"]:
        os.setsid()
    elif request["group"] >= 0:
        os.setpgid(0, request["group"])
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["folder"])
    tempfile.tempdir = None
    sys.argv = request["arguments"]
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:1] = ["", *(path for path in paths if path and path not in sys.path)]
    importlib.invalidate_caches()


def _take_files(numbers: list[int], files: list[int]) -> None:
    """Give open files their numbers, and close all others; standard ones are read and written."""
    moved = [fcntl.fcntl(file, fcntl.F_DUPFD, _FIRST) for file in files]
    for file, number in zip(moved, numbers, strict=True):
        os.dup2(file, number)
    kept = [2, *sorted(number for number in numbers if number > 2), os.sysconf("SC_OPEN_MAX")]
    for last, following in pairwise(kept):
        os.closerange(last + 1, following)
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        old = getattr(sys, name)
        by_line = number == 2 or os.isatty(number)
        new = open(  # noqa: SIM115
            number,
            "w" if number else "r",
            buffering=1 if by_line else -1,
            encoding=old.encoding,
            errors=old.errors,
            closefd=False,
        )
        setattr(sys, name, new)
        setattr(sys, f"__{name}__", new)


def run(kind: str, program: str) -> None:
    """As `python -m program` or `python -c program`."""
    if kind == "-m":
        runpy.run_module(program, run_name="__main__", alter_sys=True)
    else:
        main = sys.modules["__main__"] = types.ModuleType("__main__")
        exec(compile(program, "<string>", "exec"), vars(main))


class _End:
    """Where a program has ended well: threads have ended and all that is to be done at exit."""

    def __init__(self) -> None:
        self.status: int | None = None
        # The first that is registered is called last.
        atexit.register(self._leave)

    def note(self, stop: SystemExit | None = None) -> None:
        code = stop.code if stop else 0
        self.status = code if isinstance(code, int) else int(code is not None)

    def _leave(self) -> None:
        """Leave what is loaded as it is: to take it down, it would be copied, a third second long.

        What can't be written is Python's to tell.
        """
        if self.status is None:
            return
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except (OSError, ValueError):
            return
        os._exit(self.status)


if __name__ == "__main__":
    end = _End()
    # Ctrl-C at a terminal is for those who run the tests, and for the processes forked here.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    number, *modules = sys.argv[1:]
    for module in modules:
        importlib.import_module(module)
    gc.freeze()
    wish, open_files = serve(socket.socket(fileno=int(number)))
    become(wish, open_files)
    try:
        run(wish["kind"], wish["program"])
    except SystemExit as stop:
        end.note(stop)
        raise
    end.note()
