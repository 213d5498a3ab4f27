"""Commands that are told which of their calls fail: a process that forks one for every order."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import tempfile
import threading
import time
import traceback
from dataclasses import asdict, dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from figures.faulty_calls import MESSAGE, Fault, FaultyCalls
from figures.faulty_messages import FaultyMessages
from figures.fork_server import ForkServer

_CAMERA = EntryPoint("strange-camera", "small_bench.strange_camera:StrangeCamera", "")
"""A driver for a process of its own, which simulated devices can't have."""


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    code: its exit code, minus the signal that ended it, or None if it hung. told, printed: standard
    error and output. calls, failed: how many there were of the fault's kind. what: the first of
    them that failed. acknowledged: frames that were stored, as the run has told its caller.
    """

    code: int | None
    told: str
    printed: str
    calls: int
    failed: int
    what: str
    acknowledged: list[int]


class FaultyCommands(ForkServer):
    """A context manager; every command is a process of its own, with its libraries loaded."""

    def __init__(self) -> None:
        super().__init__("figures.faulty_command")

    def warm(self, words: list[str]) -> None:
        """Run a command line where the others are forked from, to load what it needs."""
        self.ask(json.dumps({"warm": [*map(str, words)]}))

    def run(
        self, words: list[str], folder: Path, fault: Fault | None = None, patience: float = 30.0
    ) -> Ended:
        """Run a command line; patience: seconds after which it hangs."""
        order = {
            "words": [*map(str, words)],
            "folder": str(folder),
            "fault": asdict(fault or Fault("write", 0, 0, False)),
            "patience": patience,
        }
        return Ended(**json.loads(self.ask(json.dumps(order))))


def _obey() -> None:
    """Fork a command for every line; this process has no thread that a fork could lose."""
    import labapp.bench.driver_loading
    import labapp.cli
    import labapp.runs.record.checks
    import labapp.runs.run_commands
    import labapp.runs.verifying

    # Records are checked in the process that asks, which takes no time to begin.
    labapp.runs.verifying.verify = labapp.runs.record.checks.check_record
    known = labapp.bench.driver_loading.installed_drivers() | {_CAMERA.name: _CAMERA}
    labapp.bench.driver_loading.installed_drivers = lambda: known
    print("ready", flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        found = _warm(order["warm"]) if "warm" in order else asdict(_fork(order))
        print(json.dumps(found), flush=True)


def _warm(words: list[str]) -> list[str]:
    """Run a command line here; return the threads that it has left, which a fork would lose."""
    from labapp.cli import main

    sys.argv = ["labapp", *words]
    with (
        open(os.devnull, "w") as nowhere,
        contextlib.redirect_stdout(nowhere),
        contextlib.redirect_stderr(nowhere),
        contextlib.suppress(SystemExit),
    ):
        main()
    return [thread.name for thread in threading.enumerate()]


def _fork(order: dict[str, Any]) -> Ended:
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        told, tells = os.pipe()
        process = os.fork()
        if not process:
            os.close(told)
            _become(order, out.fileno(), err.fileno(), tells)
        os.close(tells)
        code = _wait(process, order["patience"])
        with os.fdopen(told) as report:
            found = json.loads(report.read() or "{}")
        texts = []
        for file in (err, out):
            file.seek(0)
            texts.append(file.read())
    return Ended(
        code,
        *texts,
        found.get("calls", 0),
        found.get("failed", 0),
        found.get("what", ""),
        found.get("acknowledged", []),
    )


def _wait(process: int, patience: float) -> int | None:
    """Return how the process ended; kill it if it hasn't in time."""
    late = time.monotonic() + patience
    while time.monotonic() < late:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return None


def _become(order: dict[str, Any], out: int, err: int, tells: int) -> None:
    """Run a command line in this forked process, and end it."""
    from labapp.cli import main
    from labapp.runs.acquisition.frame_storage import FrameStore

    nothing = os.open(os.devnull, os.O_RDONLY)
    for number, file in enumerate((nothing, out, err)):
        os.dup2(file, number)
    sys.stdin, sys.stdout, sys.stderr = (
        open(number, mode, closefd=False, buffering=1)  # noqa: SIM115
        for number, mode in enumerate(("r", "w", "w"))
    )
    sys.argv = ["labapp", *order["words"]]
    tempfile.tempdir = order["folder"]
    fault = Fault(**order["fault"])
    calls = (FaultyMessages if fault.kind == MESSAGE else FaultyCalls)(fault, order["folder"])
    acknowledged: list[int] = []
    store = FrameStore.store_frame

    def store_frame(keeper: FrameStore, shot: Any, *given: Any) -> None:
        store(keeper, shot, *given)
        acknowledged.append(shot.index)

    FrameStore.store_frame = store_frame  # type: ignore[method-assign]
    write = os.write
    calls.install()
    code = 70
    try:
        main()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 70
    except BaseException:
        traceback.print_exc()
    # As Python does at its end: threads that aren't daemons are waited for.
    threading._shutdown()  # type: ignore[attr-defined]
    report = {
        "calls": calls.count,
        "failed": calls.failed,
        "what": calls.what,
        "acknowledged": acknowledged,
    }
    write(tells, json.dumps(report).encode())
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    _obey()
