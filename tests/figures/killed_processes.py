"""That a wired bench is left safe whichever process of it is killed, and whenever in a run."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from small_bench.files import write_small

from figures import Figure
from figures.expected_time import served_bench
from figures.startup import display
from figures.wired_trials import Killed, Trials
from figures.wired_victim import WiredVictims
from labapp.common.console import print_message

_STATES = 20

_PROCESSES = ("application", "screen", "camera", "guard", "watchdog", "filter")
_WINDOW = ("window", "engine")
"""Who is killed. The filter has a process of its own only with own_process in the bench file."""

_LONGEST = 16.0
"""Seconds after a window's start within which it or its engine is killed; its runs last longer."""


def killed_process_figures(folder: Path) -> list[Figure]:
    """Each process of a bench, killed at 20 states of a run."""
    name = f"wired bench, each of its processes killed at {_STATES} states of a run: "
    name += "left unsafe; orphans; acknowledged frames lost"
    found = kill_at_states(folder, (*_PROCESSES, *_WINDOW), _STATES)
    if found is None:
        return [Figure(name, "0; 0; 0", "the bench can't be served here", None)]
    there = [one for one in found if one.was_there]
    counts = (
        sum(bool(one.unsafe) for one in there),
        sum(one.orphans for one in there),
        sum(one.lost for one in there),
    )
    told = f"{counts[0]}; {counts[1]}; {counts[2]} of {len(there)} kills"
    wrong = [one.trouble for one in there if one.trouble]
    if wrong:
        told += f"; {len(wrong)} wrong, the first: {wrong[0]}"
    return [Figure(name, "0; 0; 0", told, not wrong and len(there) >= 0.8 * len(found))]


def kill_at_states(folder: Path, processes: Sequence[str], states: int) -> list[Killed] | None:
    """Kill each of the processes once at so many states; None if no bench can be served here."""
    write_small(folder)
    rng = np.random.default_rng(56)
    small: list[str | Path] = ["--bench", folder / "bench.toml", "--scene", folder / "scene.toml"]
    (wired := folder / "wired").mkdir()
    with (
        served_bench(wired, *small) as bench,
        WiredVictims() as victims,
        display() as environment,
    ):
        if bench is None or environment is None:
            return None
        hosted = wired / "hosted.toml"
        hosted.write_text(_with_hosted_filter(bench.read_text()))
        devices = {
            role: table["options"]
            for role, table in tomllib.loads(bench.read_text())["devices"].items()
        }
        trials = Trials(victims, folder, devices)
        found = []
        calls: dict[Path, list[str]] = {}
        for whom in processes:
            file = hosted if whom == "filter" else bench
            if file not in calls:
                # Nobody kills this run, which leaves the bench safe for the first that is killed.
                calls[file] = trials.run(file, whom, -1, 0.0)[1]
            for number in range(states):
                if whom in _WINDOW:
                    moment = (number + float(rng.uniform(0.1, 1))) / states * _LONGEST
                    found.append(trials.window(bench, whom, moment, environment))
                else:
                    # Every other kill comes somewhat later than a call begins.
                    delay = float(rng.uniform(0, 0.3)) if number % 2 else 0.0
                    call = int((number + 0.5) / states * len(calls[file]))
                    found.append(trials.run(file, whom, call, delay)[0])
                if found[-1].trouble:
                    print_message(f"  {found[-1].trouble}")
            print_message(f"  {whom} killed")
    return found


def _with_hosted_filter(text: str) -> str:
    start = text.index("[devices.filter]") + len("[devices.filter]\n")
    return f"{text[:start]}own_process = true\n{text[start:]}"


MEASUREMENTS = {"killed processes": killed_process_figures}

if __name__ == "__main__":
    import sys

    rows = kill_at_states(Path(sys.argv[1]), sys.argv[3:], int(sys.argv[2]))
    print(json.dumps([one.__dict__ for one in rows or []], indent=1))
