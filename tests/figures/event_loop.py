"""How long the window's event loop is held up while everything goes on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from figures import Figure
from figures.where import PACKAGES
from simulator.screens import NoXServer, require_program

_WALK = Path(__file__).parents[1] / "window" / "busy_walk.py"
_WALKS = 3
_LIMIT = 400.0
"""Seconds after which a walk is given up."""

_GOAL = 50.0


def event_loop_figures(folder: Path) -> list[Figure]:
    """On a virtual bench of 5 megapixels; the worst of some walks."""
    name = "event loop of the window, 2448 x 2048: live, aligning, changes, a run, restoring, help"
    goal = f"≤ {_GOAL:g} ms late beyond waiting for a core"
    try:
        require_program("Xvfb", "xvfb")
    except NoXServer as error:
        return [Figure(name, goal, str(error), None)]
    late: Counter[str] = Counter()
    beats = 0
    for number in range(_WALKS):
        found = _walked(folder / str(number))
        beats += found["beats"]
        for step, milliseconds in found["late_ms"].items():
            late[step] = max(late[step], milliseconds)
    listed = ", ".join(f"{step} {worst:.0f}" for step, worst in late.items())
    worst = max(late.values())
    seen = f"{worst:.0f} ms, the worst of {beats} turns ({listed})"
    return [Figure(name, goal, seen, worst <= _GOAL)]


def _walked(folder: Path) -> dict[str, Any]:
    folder.mkdir()
    done = subprocess.run(
        [sys.executable, str(_WALK), str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=_LIMIT,
        env=os.environ | {"PYTHONPATH": PACKAGES},
    )
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


MEASUREMENTS = {"event-loop": event_loop_figures}
