"""The window on screens of every size: nothing is cut, and nothing is out of reach."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from figures import Figure
from figures.startup import environment_of
from simulator.screens import NoXServer, xvfb

SCREENS = (
    (1280, 720, 1.0),
    (1366, 768, 1.0),
    (1920, 1080, 1.0),
    (1920, 1080, 1.5),
    (2560, 1440, 2.0),
    (3840, 2160, 1.0),
    (3840, 2160, 2.0),
)
"""Width and height in pixels, and scale."""


def window_fit_figures(folder: Path) -> list[Figure]:
    """Open the window on each screen, and look at every label and control of its tabs and docks."""
    return [_on_screen(folder, *screen) for screen in SCREENS]


def _on_screen(folder: Path, width: int, height: int, scale: float) -> Figure:
    name = f"window on {width} × {height} at scale {scale:g}"
    goal = "no text cut, no control out of reach, all tabs and panels"
    home = folder / f"{width}-{scale:g}"
    home.mkdir()
    try:
        with xvfb(width, height) as server:
            found = _probe(home, server.display, scale)
    except NoXServer as error:
        return Figure(name, goal, str(error), None)
    faults = [fault for listed in found["faults"].values() for fault in listed]
    seen = "none" if found["came"] else "no picture came"
    if faults:
        seen = f"{len(set(faults))}, the first: {faults[0]}"
    return Figure(name, goal, seen, not faults and bool(found["came"]))


def _probe(home: Path, display: str, scale: float) -> dict[str, dict[str, list[str]]]:
    child = Path(__file__).with_name("window_probe.py")
    environment = {
        **os.environ,
        **environment_of(home),
        "DISPLAY": display,
        "QT_QPA_PLATFORM": "xcb",
        "QT_SCALE_FACTOR": f"{scale:g}",
    }
    command = [sys.executable, "-P", str(child), os.environ.get("LABAPP_PICTURES", "")]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    found: dict[str, dict[str, list[str]]] = json.loads(done.stdout.splitlines()[-1])
    return found


MEASUREMENTS = {"window-fit": window_fit_figures}
