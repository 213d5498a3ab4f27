"""Live pictures of 5 megapixels in a real window: frames that reach the screen, and their cost."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from small_bench.files import Size, bench_text

from drivers.x11.reader import ScreenReader
from figures import Figure
from figures.startup import display, environment_of
from labapp.files.reading import bundled_path

_SHAPE = (2048, 2448)
_SECONDS = 10.0
_PATCH = 48
"""Side of the part of the picture that is read off the screen, in its middle."""

_POLL = 2e-3
"""Seconds between looks at the screen: a small part of the time of a frame."""

_RATE_GOALS = {0.001: 40.0, 0.1: 30.0}
_GAP_GOAL, _CPU_GOAL = 60.0, 12.0
_VIRTUAL_RATE_GOAL, _VIRTUAL_GAP_GOAL = 20.0, 120.0

_SCENE = """
version = 1
title = "Photograph"
[targets.photograph]
kind = "photograph"
file = "{photograph}"
distance_m = 2.0
radiance = 0.1
cover = 1.05
"""


@dataclass(frozen=True)
class Seen:
    """rate: distinct pictures a second on the screen. gap: 99th percentile of the milliseconds
    between them. window: what the window's process said of itself. beside: what else the machine
    did.
    """

    rate: float
    gap: float
    window: dict[str, float]
    beside: str


def window_live_figures(folder: Path) -> list[Figure]:
    """With a camera whose frames are ready, and with the virtual bench."""
    with display() as environment:
        if environment is None:
            return [Figure("live window", "seen", "no display: apt-get install xvfb", None)]
        figures = [
            figure
            for share, goal in _RATE_GOALS.items()
            for figure in _camera_figures(folder / f"{share:g}", environment, share, goal)
        ]
        return figures + _virtual_figures(folder / "virtual", environment)


def _camera_figures(
    folder: Path, environment: dict[str, str], share: float, goal: float
) -> list[Figure]:
    """With the noise camera, of whose pixels a share is saturated."""
    options = f"rows = {_SHAPE[0]}, columns = {_SHAPE[1]}, saturated = {share:g}"
    text = bench_text(Size(sensor=_SHAPE), camera_options=options)
    install_noise_camera(folder)
    seen = _seen(folder, environment, text.replace("simulated-camera", "noise-camera"))
    name = f"live window, 2448 x 2048, {100 * share:g} % saturated"
    cpu = seen.window["window_cpu_ms"]
    return [
        Figure(
            f"{name}: distinct pictures on the screen",
            f"≥ {goal:g} /s, gap p99 ≤ {_GAP_GOAL:g} ms",
            f"{seen.rate:.1f} /s, {seen.gap:.0f} ms{seen.beside}",
            seen.rate >= goal and seen.gap <= _GAP_GOAL,
        ),
        Figure(
            f"{name}: processor time of the window's process",
            f"≤ {_CPU_GOAL:g} ms a frame",
            f"{cpu:.1f} ms{seen.beside}",
            cpu <= _CPU_GOAL,
        ),
    ]


def _virtual_figures(folder: Path, environment: dict[str, str]) -> list[Figure]:
    """With the virtual bench before the bundled photograph, as many pixels."""
    folder.mkdir()
    seen = _seen(folder, environment, bench_text(Size(sensor=_SHAPE)))
    return [
        Figure(
            "live window, 2448 x 2048, virtual bench: distinct pictures on the screen",
            f"≥ {_VIRTUAL_RATE_GOAL:g} /s, gap p99 ≤ {_VIRTUAL_GAP_GOAL:g} ms",
            f"{seen.rate:.1f} /s, {seen.gap:.0f} ms{seen.beside}",
            seen.rate >= _VIRTUAL_RATE_GOAL and seen.gap <= _VIRTUAL_GAP_GOAL,
        )
    ]


def install_noise_camera(folder: Path) -> None:
    """Give a folder the entry point of the noise camera, as an installed package has it."""
    facts = folder / "noise_camera-1.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: noise-camera\nVersion: 1\n")
    camera = "noise-camera = noise_camera:NoiseCamera"
    (facts / "entry_points.txt").write_text(f"[labapp.devices]\n{camera}\n")
    module = Path(__file__).with_name("noise_camera.py")
    (folder / module.name).write_text(module.read_text())


def other_load() -> str:
    """What else the machine does, in words, if that is enough to change what is measured.

    It is looked at for a second, in which this process waits.
    """
    before = _busy_seconds()
    time.sleep(1.0)
    load, cores = _busy_seconds() - before, os.cpu_count() or 1
    return f"; beside other work, {load:.1f} of {cores} cores busy" if load > 0.1 * cores else ""


def _busy_seconds() -> float:
    """Processor time that all cores spent with anything, since the machine started."""
    user, nice, system, _idle, _waiting, *others = map(
        int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:]
    )
    return (user + nice + system + sum(others[:2])) / os.sysconf("SC_CLK_TCK")


def _seen(folder: Path, environment: dict[str, str], bench: str) -> Seen:
    """Open a window on a bench, and look at the screen while it is live."""
    beside = other_load()
    files = {"bench.toml": bench, "scene.toml": _scene()}
    for name, text in files.items():
        (folder / name).write_text(text)
    child = Path(__file__).with_name("live_window.py")
    command = [sys.executable, "-P", str(child), str(time.monotonic()), str(_SECONDS)]
    command += [str(folder / name) for name in files]
    own = environment | environment_of(folder)
    with subprocess.Popen(command, env=own, stdout=subprocess.PIPE, text=True) as window:
        assert window.stdout is not None
        place = json.loads(window.stdout.readline())["place"]
        changes = _changes(environment["DISPLAY"], place)
        said = json.loads(window.stdout.readline())
    gaps = np.diff(changes)
    return Seen(
        len(gaps) / (changes[-1] - changes[0]), 1e3 * float(np.quantile(gaps, 0.99)), said, beside
    )


def _scene() -> str:
    return _SCENE.format(photograph=bundled_path("photograph.jpg"))


def _changes(shown_on: str, place: list[int]) -> list[float]:
    """When the middle of the picture became another one, in seconds, for most of the time."""
    x, y, width, height = place
    region = (x + (width - _PATCH) // 2, y + (height - _PATCH) // 2, _PATCH, _PATCH)
    late, before, moments = time.monotonic() + 0.9 * _SECONDS, b"", []
    with ScreenReader(shown_on, region) as screen:
        while (now := time.monotonic()) < late:
            if screen.has_changed() and (seen := screen.pixels().tobytes()) != before:
                before = seen
                moments.append(now)
            time.sleep(_POLL)
    return moments


MEASUREMENTS = {"window-live": window_live_figures}
