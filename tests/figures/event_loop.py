"""How long the window's event loop is held up while everything goes on."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from figures import Figure
from figures.walks import walk
from simulator.screens import NoXServer, require_program

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
        found = walk("busy_walk.py", folder / str(number), _LIMIT)
        if isinstance(found, str):
            return [Figure(name, goal, found, None)]
        beats += found["beats"]
        for step, milliseconds in found["late_ms"].items():
            late[step] = max(late[step], milliseconds)
    listed = ", ".join(f"{step} {worst:.0f}" for step, worst in late.items())
    worst = max(late.values())
    seen = f"{worst:.0f} ms, the worst of {beats} turns ({listed})"
    return [Figure(name, goal, seen, worst <= _GOAL)]


MEASUREMENTS = {"event-loop": event_loop_figures}
