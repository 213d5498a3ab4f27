"""Real processes without their first seconds: as `subprocess`, but forked.

`forked.Popen` and `forked.run` take `[sys.executable, "-m" or "-c", ...]` as those of `subprocess`
do: pipes, terminals, signals, groups and ends of processes are real, and the process is a child
of this one. Only what Python itself does when it starts is missing: its options, the variables
that it reads (but PYTHONPATH), and the loading of libraries. Who tests those starts a true one.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from subprocess import DEVNULL, PIPE, STDOUT, CompletedProcess, TimeoutExpired
from typing import Any

from forked.server import LIMIT

__all__ = ["DEVNULL", "PIPE", "STDOUT", "CompletedProcess", "Popen", "TimeoutExpired", "run"]

LOADED = (
    "labapp.cli",
    "labapp.runs.run_commands",
    "labapp.runs.record.checks",
    "labapp.studies.command",
    "labapp.bench.virtual_bench.serving",
    "labapp.window.engine.engine_loop",
    "read_files",
)
"""What processes would spend their first seconds with. Nothing of it starts threads."""

_SET_CHILD_SUBREAPER = 36
"""Of prctl(2); from linux/prctl.h."""


_PROGRAM = Path(__file__).with_name("server.py")


def _packages() -> list[str]:
    """Where modules are looked for, the application's first: its tests' folder has its name."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return [str(Path(__file__).parents[2]), *(path for path in given if path)]


class _Server:
    """The process that is forked from, and a line to it."""

    def __init__(self, *modules: str) -> None:
        self._line, others = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with others:
            number = others.fileno()
            self._process = subprocess.Popen(
                [sys.executable, str(_PROGRAM), str(number), *modules],
                stdin=DEVNULL,
                stdout=DEVNULL,
                pass_fds=[number],
                env=os.environ | {"PYTHONPATH": os.pathsep.join(_packages())},
            )
        self._lock = threading.Lock()
        self._adopt = ctypes.CDLL(None).prctl
        atexit.register(self.close)

    def fork(self, request: dict[str, Any], files: Sequence[int]) -> int:
        """Ask for a process with these open files; its number."""
        data = json.dumps(request).encode()
        assert len(data) < LIMIT
        with self._lock:
            # Its parent leaves it at once: so it becomes ours.
            self._adopt(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
            try:
                socket.send_fds(self._line, [data], list(files))
                return int(self._line.recv(100))
            finally:
                self._adopt(_SET_CHILD_SUBREAPER, 0, 0, 0, 0)

    def close(self) -> None:
        self._line.close()
        self._process.wait()


@cache
def _server() -> _Server:
    return _Server(*LOADED)


class Popen(subprocess.Popen):
    """A process as `subprocess.Popen` makes it, forked from one that has its libraries loaded."""

    def _execute_child(
        self,
        args: Sequence[str],
        executable: str | None,
        preexec_fn: object,
        close_fds: bool,
        pass_fds: Sequence[int],
        cwd: str | os.PathLike[str] | None,
        env: dict[str, str] | None,
        startupinfo: object,
        creationflags: int,
        shell: bool,
        p2cread: int,
        p2cwrite: int,
        c2pread: int,
        c2pwrite: int,
        errread: int,
        errwrite: int,
        restore_signals: bool,
        gid: int | None,
        gids: Sequence[int] | None,
        uid: int | None,
        umask: int,
        start_new_session: bool,
        process_group: int,
    ) -> None:
        python, kind, program, *others = map(str, args)
        if python != sys.executable or kind not in ("-m", "-c"):
            raise ValueError(f"arguments are {args!r}; they must be Python's, and -m or -c")
        if preexec_fn or executable or shell or not close_fds or umask != -1:
            raise ValueError("such options are for a process that isn't forked")
        request = {
            "kind": kind,
            "program": program,
            "arguments": [kind, *others],
            "environment": dict(os.environ if env is None else env),
            "folder": os.fspath(cwd or os.getcwd()),
            "session": start_new_session,
            "group": process_group,
            "parent": os.getpid(),
            "blocked": sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ())),
            "files": [0, 1, 2, *pass_fds],
        }
        given = enumerate((p2cread, c2pwrite, errwrite))
        standard = [number if file == -1 else file for number, file in given]
        self.pid = _server().fork(request, [*standard, *pass_fds])
        self._child_created = True
        self._close_pipe_fds(p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite)


def run(
    arguments: Sequence[str],
    *,
    input: str | bytes | None = None,
    capture_output: bool = False,
    timeout: float | None = None,
    check: bool = False,
    **options: Any,
) -> CompletedProcess[Any]:
    """`subprocess.run` with a forked process."""
    if input is not None:
        options["stdin"] = PIPE
    if capture_output:
        options |= {"stdout": PIPE, "stderr": PIPE}
    with Popen(arguments, **options) as process:
        try:
            output, errors = process.communicate(input, timeout=timeout)
        except BaseException:
            process.kill()
            raise
    done = CompletedProcess(arguments, process.returncode, output, errors)
    if check:
        done.check_returncode()
    return done
