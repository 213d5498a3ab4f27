"""What stray and meant gestures do at the window, and how soon a setting is undone."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from window.plan_files import write_plan
from window.window_scene import write_bench

from figures import Figure
from figures.startup import display, environment_of

_SEED = 33
_STRAY, _MEANT = 500, 200
_UNDO_GOAL = 1.0
_LONG = 2000


def gesture_figures(folder: Path) -> list[Figure]:
    """Gestures at a window of its own on the small bench, whose pictures take no time."""
    stray = f"{_STRAY} stray gestures: hardware moves, runs lost"
    meant = f"{_MEANT} settings that are meant: obeyed"
    undo = f"undo after each of {_MEANT} random settings: read-back as before"
    goals = "0, 0", f"{_MEANT}", f"{_MEANT} in ≤ {_UNDO_GOAL:g} s"
    with display() as environment:
        if environment is None:
            names = stray, meant, undo
            why = "no display: apt-get install xvfb"
            return [Figure(name, goal, why, None) for name, goal in zip(names, goals, strict=True)]
        found = _gestures(folder, environment)
    moves, lost = len(found["moves"]), found["lost"]
    seconds = found["seconds"]
    soon = sum(one <= _UNDO_GOAL for one in seconds)
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(found["stray"].items()))
    return [
        Figure(
            stray,
            goals[0],
            f"{moves}, {lost} of {found['runs']}; {kinds}; seed {_SEED}",
            moves == 0 and lost == 0 and found["unmoved"],
        ),
        Figure(meant, goals[1], f"{found['obeyed']}", found["obeyed"] == _MEANT),
        Figure(
            undo,
            goals[2],
            f"{soon}; median {seconds[len(seconds) // 2]:.2f} s, worst {seconds[-1]:.2f} s",
            soon == _MEANT,
        ),
    ]


def _gestures(folder: Path, environment: dict[str, str]) -> dict[str, Any]:
    files = write_bench(folder)
    plan = write_plan(folder, "Long", repeats=_LONG)
    child = Path(__file__).with_name("window_gestures.py")
    environment = environment | environment_of(folder)
    numbers = map(str, (_SEED, _STRAY, _MEANT))
    paths = map(str, (files.bench, files.scene, plan, folder / "runs"))
    command = [sys.executable, "-P", str(child), *paths, *numbers]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


MEASUREMENTS = {"gestures": gesture_figures}
