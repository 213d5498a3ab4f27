"""Runs on a wired bench of which one process is killed with SIGKILL, at a state of the run.

A state is a call of a device: the run counts its calls, kills at the one that it was told, and
some time after it began.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.supervised import SupervisedDevice
from figures.victim import Victims, obey
from labapp.bench.opening import BenchFiles, open_bench
from labapp.common.frame_delays import FrameDelays
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan

MARK = "LABAPP_KILLED_TRIAL"
"""Environment variable by which the processes of a run are known."""

_CHILDREN = {
    "screen": ("drivers.hosted.serving:serve", 0),
    "filter": ("drivers.hosted.serving:serve", 1),
    "camera": ("library.request_server:main", 0),
    "guard": ("drivers.hosted.guard:serve_guard", 0),
}
"""A word of the command of a device's process, and which one it is of those that have it."""

_APPEARS_WITHIN = 60.0
"""Seconds after which a process that isn't there won't be."""


class WiredVictims(Victims):
    """A context manager; each run is a process of its own, with its libraries loaded."""

    module = "figures.wired_victim"

    def begin_killed(self, **order: Any) -> int:
        """Begin a run, and say whom it kills; its process number. See _run()."""
        return int(self.ask(json.dumps(order)))


def process_of(mark: str, whom: str) -> int:
    """The process of a run that does something; 0 if there's none now."""
    if whom == "watchdog":
        return next((one for one in marked(mark) if _parent(one) == 1), 0)
    word, number = _CHILDREN[whom]
    found = [
        one
        for one in sorted(marked(mark))
        if word.encode() in _read(one, "cmdline") and _parent(one) != 1
    ]
    return found[number] if len(found) > number else 0


def marked(mark: str) -> list[int]:
    """The living processes of a run, which have its mark in their environment."""
    word = f"{MARK}={mark}".encode()
    return [
        int(name)
        for name in os.listdir("/proc")
        if name.isdigit() and word in _read(int(name), "environ")
    ]


def _read(process: int, name: str) -> bytes:
    with suppress(OSError):
        return Path("/proc", str(process), name).read_bytes()
    return b""


def _parent(process: int) -> int:
    told = _read(process, "stat").rpartition(b")")[2].split()
    return int(told[1]) if told else 0


class _Killer:
    """Count the calls of devices, and kill a process at one of them. order: see _run()."""

    def __init__(self, order: dict[str, Any]) -> None:
        self._order, self._calls = order, list[str]()
        self._events = os.open(order["events"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._thread: threading.Thread | None = None

    def note(self, role: str, command: str) -> None:
        os.write(self._events, f"{role}: {command}\n".encode())
        self._calls.append(command)
        if len(self._calls) - 1 == self._order["call"]:
            self._thread = threading.Thread(target=self._kill, daemon=True)
            self._thread.start()
            if not self._order["delay"]:
                self._thread.join()

    def _kill(self) -> None:
        time.sleep(self._order["delay"])
        whom, late = self._order["whom"], time.monotonic() + _APPEARS_WITHIN
        if whom == "application":
            os.write(self._events, b"killed\n")
            os.kill(os.getpid(), signal.SIGKILL)
        while time.monotonic() < late:
            if found := process_of(self._order["mark"], whom):
                with suppress(ProcessLookupError):
                    os.kill(found, signal.SIGKILL)
                    os.write(self._events, b"killed\n")
                return
            time.sleep(0.005)


def _run(order: dict[str, Any]) -> None:
    """Run a plan into a record on a bench, and kill one of its processes.

    order: "bench", "plan", "path" (of the record), "acknowledged" and "events" (files that lines
    are added to), "mark", "whom", "call" (its number, -1 for none) and "delay" (seconds).
    """
    os.environ[MARK] = order["mark"]
    killer = _Killer(order)
    ask, wait = SupervisedDevice._ask, SupervisedDevice.begin_make_safe

    def noting(device: Any, command: str, *given: Any) -> Any:
        killer.note(device.role, command)
        return ask(device, command, *given)

    def noting_end(device: Any) -> Any:
        killer.note(device.role, "make safe")
        return wait(device)

    SupervisedDevice._ask = noting  # type: ignore[method-assign]
    SupervisedDevice.begin_make_safe = noting_end  # type: ignore[method-assign]
    handle = os.open(order["acknowledged"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def tell(shot: Any, frame: Any) -> None:
        # One write a line, so that a kill can't cut one in two.
        os.write(handle, f"{shot.index}\n".encode())

    code = 1
    try:
        with open_bench(BenchFiles.with_defaults(Path(order["bench"]))) as bench:
            # It would be measured by more frames than the run has.
            bench.frame_delays = FrameDelays()
            plan = PlanFile.model_validate(order["plan"])
            run_plan(
                bench, plan, Path(order["path"]), Attendance(ask=lambda *_: None, on_frame=tell)
            )
        code = 0
    except Exception as error:
        os.write(2, f"{type(error).__name__}: {error}\n".encode())
    finally:
        os._exit(code)


if __name__ == "__main__":
    obey(_run)
