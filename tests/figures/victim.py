"""Runs that are there to be killed: a process that forks one for every order it is given."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from small_bench.setups import small_setup

from figures.fork_server import ForkServer
from labapp.bench.opening import open_bench
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import resume_run, run_plan


class Victims(ForkServer):
    """A context manager; every run is a process of its own, with its libraries loaded."""

    module = "figures.victim"

    def __init__(self) -> None:
        super().__init__(self.module)

    def begin(self, path: Path, acknowledged: Path, plan: PlanFile | None) -> int:
        """Begin a run of a plan into a record, or to resume it (None); its process number.

        acknowledged: a file that it adds the index of every stored frame to.
        """
        order = {
            "path": str(path),
            "acknowledged": str(acknowledged),
            "plan": plan.model_dump(mode="json") if plan else None,
        }
        return int(self.ask(json.dumps(order)))

    def kill(self, process: int) -> bool:
        """Kill it with SIGKILL; False if it had ended before."""
        # Nobody else gets its number before its parent has heard of its end.
        os.kill(process, signal.SIGKILL)
        return self.end() == -signal.SIGKILL

    def end(self) -> int:
        """Wait for the end of the run: its exit code, or minus the signal that ended it."""
        return int(self.ask("wait"))


def obey(run: Callable[[dict[str, Any]], None]) -> None:
    """Fork a run for every line; this process has no thread that a fork could lose."""
    print("ready", flush=True)
    process = 0
    for line in sys.stdin:
        if line.strip() == "wait":
            _, status = os.waitpid(process, 0)
            print(os.waitstatus_to_exitcode(status), flush=True)
            continue
        process = os.fork()
        if not process:
            run(json.loads(line))
        print(process, flush=True)


def _run(order: dict[str, Any]) -> None:
    handle = os.open(order["acknowledged"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def tell(shot: Any, frame: Any) -> None:
        # One write a line, so that a kill can't cut one in two.
        os.write(handle, f"{shot.index}\n".encode())

    try:
        with open_bench(small_setup()) as bench:
            path = Path(order["path"])
            if order["plan"] is None:
                resume_run(bench, path, Attendance(on_frame=tell))
            else:
                plan = PlanFile.model_validate(order["plan"])
                run_plan(bench, plan, path, Attendance(on_frame=tell))
    finally:
        os._exit(0)


if __name__ == "__main__":
    obey(_run)
