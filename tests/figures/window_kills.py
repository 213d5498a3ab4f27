"""That a window or an engine that is killed loses no run, no frame and no setting."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from small_bench.files import write_small

from figures import Figure
from figures.startup import display, environment_of
from labapp.common.console import print_message
from labapp.runs.record.reader import Record
from labapp.runs.state import State

_KILLS = 30

_LONGEST = 6.0
"""Seconds after the window's start, or after its queue came back, within which it is killed."""

_PATIENCE = 120.0
"""Seconds in which a queue comes back."""

_PLAN = """
version = 1
title = "Plan {number}"

[patterns.neutral]
kind = "constant"

[[acquire]]
targets = ["dark", "star"]
patterns = ["neutral"]
wavelengths_nm = [550]
exposures_ms = [1, 8]
repeats = {repeats}
"""


def window_kill_figures(folder: Path) -> list[Figure]:
    """One bench, 30 moments: window, engine or both get SIGKILL; then all that is left is taken."""
    name = f"window: {_KILLS} kill -9 of window, engine or both at random moments"
    goal = "queue, settings and runs come back, 0 acknowledged frames lost"
    with display() as environment:
        if environment is None:
            return [Figure(name, goal, "no display: apt-get install xvfb", None)]
        _write_bench(folder)
        _kill_often(folder, environment)
    seen = judge(folder)
    return [Figure(name, goal, *seen)]


def _write_bench(folder: Path) -> None:
    write_small(folder)
    (folder / "runs").mkdir()
    write_plans(folder)


def write_plans(folder: Path) -> None:
    """Write the plans that a window is asked for."""
    for number, repeats in enumerate((2, 10, 60)):
        text = _PLAN.format(number=number, repeats=repeats)
        (folder / f"plan-{number}.toml").write_text(text)


def _kill_often(folder: Path, environment: dict[str, str]) -> None:
    rng = np.random.default_rng(33)
    process: subprocess.Popen[str] | None = None
    for number in range(_KILLS):
        if process is None:
            process = _begin(folder, environment, str(number))
        whom = ("window", "engine", "both")[number % 3]
        # Every third moment is within the opening, the others when the queue is back.
        if rng.random() > 1 / 3:
            _wait_for_queue(process)
        time.sleep(rng.random() * _LONGEST)
        if whom != "window":
            _kill_engine(process)
        if whom != "engine":
            process.kill()
            process.wait()
            process = None
        if number % 10 == 9:
            print_message(f"  {number + 1} of {_KILLS} kills")
    if process is not None:
        process.kill()
        process.wait()
    done = _begin(folder, environment, "finish")
    done.communicate(timeout=_PATIENCE)


def _begin(folder: Path, environment: dict[str, str], seed: str) -> subprocess.Popen[str]:
    child = Path(__file__).with_name("window_victim.py")
    environment = environment | environment_of(folder)
    command = [sys.executable, "-P", str(child), str(folder), seed]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)


def _wait_for_queue(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "back\n"


def _kill_engine(window: subprocess.Popen[str]) -> None:
    """Kill the window's child, if it has begun to run."""
    children = Path(f"/proc/{window.pid}/task/{window.pid}/children")
    for child in children.read_text().split():
        os.kill(int(child), signal.SIGKILL)


def judge(folder: Path) -> tuple[str, bool]:
    """Compare what the window had shown with what came back, and with the records at the end."""
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    wrong: list[str] = []
    open_runs: set[str] = set()
    stored: dict[str, int] = {}
    # The last one that must have been kept, and those that were set after it.
    exposures: set[float] = set()
    returns = asked = 0
    for line in lines:
        if "asked" in line:
            asked += 1
            open_runs.add(line["asked"])
        elif "run" in line:
            if line["ended"]:
                open_runs.discard(line["run"])
            stored[line["path"]] = max(stored.get(line["path"], 0), line["stored"])
        elif "back" in line:
            returns += 1
            if missing := open_runs - set(line["back"]):
                wrong.append(f"runs that didn't come back: {sorted(missing)}")
            if exposures and line["exposure"] not in exposures:
                wrong.append(f"exposure {line['exposure']} for {sorted(exposures)}")
            exposures = {line["exposure"]}
        elif "set" in line:
            exposures.add(line["set"])
        elif "exposure" in line:
            exposures = {line["exposure"]}
    if "finished" not in lines[-1]:
        wrong.append("the last window didn't end")
    lost, states = _look(stored)
    wrong += [f"{path}: {state}" for path, state in states.items() if state is not State.COMPLETE]
    told = (
        f"{lost} of {sum(stored.values())} frames lost, {len(stored)} records of {asked} requests, "
        f"queue back {returns} times"
    )
    if wrong:
        told += f"; {len(wrong)} wrong, the first: {wrong[0]}"
    return told, not lost and not wrong and len(stored) == asked


def _look(stored: dict[str, int]) -> tuple[int, dict[str, Any]]:
    """How many acknowledged frames the records lack, and the records' states."""
    lost, states = 0, {}
    for path, count in stored.items():
        with Record(Path(path)) as record:
            states[path] = record.state
            lost += max(0, count - (record.frame_count - len(record.frames_not_stored())))
    return lost, states


MEASUREMENTS = {"window-kills": window_kill_figures}
