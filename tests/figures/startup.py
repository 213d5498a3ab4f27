"""How long a person waits before anything is there."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path

from figures import Figure
from figures.where import PACKAGES
from labapp.bench.driver_loading import DRIVER_GROUP
from simulator.screens import NoXServer, xvfb
from simulator.screens.server import authority_file

_REPEATS = 5
_HELP_GOAL, _WINDOW_GOAL = 0.5, 2.5
_IMPORT_GOAL = 0.3
_HEAVY = ["torch", "PySide6", "cv2", "serial", "usb", "gi"]


def help_time(folder: Path) -> list[Figure]:
    """Median wall time of `labapp --help` as a process."""
    seconds = []
    for _ in range(_REPEATS):
        started = time.perf_counter()
        command = [sys.executable, "-m", "labapp", "--help"]
        subprocess.run(command, check=True, capture_output=True)
        seconds.append(time.perf_counter() - started)
    median = statistics.median(seconds)
    goal = f"≤ {_HELP_GOAL} s"
    return [Figure("labapp --help", goal, f"{median:.2f} s", median <= _HELP_GOAL)]


def import_time(folder: Path) -> list[Figure]:
    """Median processor time that importing all drivers takes, and what comes with them."""
    drivers = sorted({entry.value.partition(":")[0] for entry in entry_points(group=DRIVER_GROUP)})
    ours = [name for name in drivers if name.startswith("drivers")]
    done = [_imported(ours) for _ in range(_REPEATS)]
    median = statistics.median(seconds for seconds, _ in done)
    heavy = sorted({name for _, loaded in done for name in loaded})
    measured = f"{median:.2f} s, {', '.join(heavy) or 'none of these'} loaded"
    goal = f"≤ {_IMPORT_GOAL} s of processor time; no torch, Qt, cv2, serial, usb, gi"
    return [Figure("importing all drivers", goal, measured, median <= _IMPORT_GOAL and not heavy)]


def _imported(modules: list[str]) -> tuple[float, list[str]]:
    script = (
        "import json, sys, time; before = time.process_time(); "
        f"import {', '.join(modules)}; took = time.process_time() - before; "
        f"print(json.dumps([took, [name for name in {_HEAVY!r} if name in sys.modules]]))"
    )
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True)
    seconds, loaded = json.loads(done.stdout)
    return seconds, loaded


def window_time(folder: Path) -> list[Figure]:
    """Median time from process start to the window's first painting, and its memory."""
    name, goal = "window shown from process start", f"≤ {_WINDOW_GOAL} s"
    with display() as environment:
        if environment is None:
            return [Figure(name, goal, "no display: apt-get install xvfb", None)]
        found = [_one_window(environment) for _ in range(_REPEATS)]
    median = statistics.median(seconds for seconds, _ in found)
    memory = statistics.median(megabytes for _, megabytes in found)
    measured = f"{median:.2f} s, {memory:.0f} MB"
    return [Figure(name, goal, measured, median <= _WINDOW_GOAL)]


def _one_window(environment: dict[str, str]) -> tuple[float, float]:
    child = Path(__file__).with_name("window_startup.py")
    environment = environment | {"PYTHONPATH": PACKAGES}
    command = [sys.executable, "-P", str(child), str(time.monotonic())]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    said = json.loads(done.stdout.splitlines()[-1])
    return float(said["seconds_to_window"]), float(said["rss_mb"])


@contextmanager
def display() -> Iterator[dict[str, str] | None]:
    """An environment with an X display: the user's own, or a virtual one while it is needed."""
    if os.environ.get("DISPLAY"):
        yield dict(os.environ)
        return
    try:
        with xvfb(1920, 1080) as server:
            yield {**os.environ, "DISPLAY": server.display, "QT_QPA_PLATFORM": "xcb"}
    except NoXServer:
        yield None


def environment_of(folder: Path) -> dict[str, str]:
    """Variables of a window's process whose settings and packages are in a folder.

    The cookie of the X server is where it was.
    """
    return {
        "PYTHONPATH": os.pathsep.join([PACKAGES, str(folder)]),
        "XDG_CONFIG_HOME": str(folder / "config"),
        "HOME": str(folder),
        "XAUTHORITY": str(authority_file()),
    }


MEASUREMENTS = {"help": help_time, "window": window_time, "import": import_time}
