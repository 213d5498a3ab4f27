"""How soon the window shows its first picture, and that of a new pattern, coarse and exact."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path

from figures import Figure
from figures.startup import display, environment_of
from figures.window_live import other_load
from labapp.files.reading import bundled_path

_KINDS = ["Fresnel lens", "Axicon", "Cubic", "Annular", "Sine", "Aberrations", "Blazed grating"]
"""Kinds of patterns whose grey levels follow from a formula: what takes time is the picture."""

_SMALL, _LARGE = "768 x 512", "2448 x 2048"
_SHOWN_GOAL, _FIRST_GOALS = 1.0, (2.5, 4.0)
_BUSY_GOAL, _PREDICTION_GOALS = 0.1, (0.5, 0.1)
_PICTURE_GOALS = {_SMALL: (1.0, 3.0), _LARGE: (3.0, 8.0)}


def window_changes_figures(folder: Path) -> list[Figure]:
    """On the bundled bench, and on the same with a sensor of 5 megapixels."""
    with display() as environment:
        if environment is None:
            return [Figure("patterns in the window", "seen", "no display: get xvfb", None)]
        beside = other_load()
        found = {size: _found(folder, environment, size) for size in _PICTURE_GOALS}
    start = found[_SMALL][0]
    coarse, exact = start.get("prediction", start["exact"]), start["exact"]
    figures = [
        Figure(
            "window shown, and its first picture: coarse and marked / exact, bundled bench",
            f"≤ {_SHOWN_GOAL:g} s, ≤ {_FIRST_GOALS[0]:g} / {_FIRST_GOALS[1]:g} s",
            f"{start['window']:.2f} s, {coarse:.1f} / {exact:.1f} s{beside}",
            start["window"] <= _SHOWN_GOAL
            and coarse <= _FIRST_GOALS[0]
            and exact <= _FIRST_GOALS[1],
        )
    ]
    for size, moments in found.items():
        figures += _figures(size, moments[1:], beside)
    return figures


def _figures(size: str, changes: list[dict[str, float]], beside: str) -> list[Figure]:
    """Of the changes of pattern on a bench with a sensor of some size."""
    busy = [one["busy"] for one in changes if "busy" in one]
    exact = [one["exact"] for one in changes]
    coarse = [one["prediction"] for one in changes if "prediction" in one]
    errors = [one["prediction_error"] for one in changes if "prediction" in one]
    median, worst = statistics.median(exact), max(exact)
    soon, near = _PREDICTION_GOALS
    usual, longest = _PICTURE_GOALS[size]
    return [
        Figure(
            f"{size}, a pattern is shown: it is said what the picture waits for",
            f"≤ {1e3 * _BUSY_GOAL:g} ms",
            f"{1e3 * max(busy):.0f} ms, slowest of {len(busy)}{beside}",
            max(busy) <= _BUSY_GOAL,
        ),
        Figure(
            f"{size}, coarse prediction, L2 against the mean of 16 exact frames",
            f"≤ {soon:g} s, within {100 * near:g} %",
            f"median {statistics.median(coarse):.2f} s, worst {max(coarse):.2f} s, "
            f"within {100 * max(errors):.1f} %; {len(coarse)} of {len(changes)} came first{beside}",
            max(coarse) <= soon and max(errors) <= near,
        ),
        Figure(
            f"{size}, exact picture of a new pattern",
            f"median ≤ {usual:g} s, worst ≤ {longest:g} s",
            f"median {median:.1f} s, worst {worst:.1f} s, {len(exact)} patterns{beside}",
            median <= usual and worst <= longest,
        ),
    ]


def bundled_bench(width: int, height: int) -> str:
    """The bundled bench's file with another number of pixels."""
    text = bundled_path("bench.toml").read_text()
    return text.replace("width = 768", f"width = {width}").replace(
        "height = 512", f"height = {height}"
    )


def _found(folder: Path, environment: dict[str, str], size: str) -> list[dict[str, float]]:
    """The moments of the start, and of each pattern."""
    width, height = map(int, size.split(" x "))
    bench = folder / f"bench-{width}.toml"
    bench.write_text(bundled_bench(width, height))
    child = Path(__file__).with_name("changing_window.py")
    files = [str(bench), str(bundled_path("scene.toml"))]
    command = [sys.executable, "-P", str(child), str(time.monotonic()), *files, *_KINDS]
    own = environment | environment_of(folder)
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=own)
    found: list[dict[str, float]] = json.loads(done.stdout.splitlines()[-1])
    return found


MEASUREMENTS = {"window-changes": window_changes_figures}
