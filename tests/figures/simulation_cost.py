"""What simulated pictures cost: deciding beside rendering, and whole runs of the ready plans."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

from figures import TOLD, Figure
from figures.live import spreading_patterns
from labapp.bench.opening import BenchFiles, read_scene
from labapp.files.bench_file import BenchFile
from labapp.files.reading import bundled_path, read_file
from optics.threads import single_threaded
from simulator.world import World

_SHARE_GOAL, _MEMORY_GOAL = 1 / 3, 2.0
_EXPOSURE = 0.01
_SCENES = (
    "bricks", "charts", "colorchecker", "cube", "display", "flicker", "motorcycle", "moving",
    "photograph", "pinhole", "star",
)  # fmt: skip
_PLANS = (
    "coded-snapshot", "edof-target", "phase-video-stability", "photon-transfer",
    "psf-over-wavelengths", "slm-response", "spectral-stack",
)  # fmt: skip


@single_threaded
def planning_figures(folder: Path) -> list[Figure]:
    """Every target of the bundled scenes behind seven patterns, on the bundled bench."""
    shares, planning, rendering = [], 0.0, 0.0
    for name in _SCENES:
        decided, rendered = _costs(name)
        shares.append(f"{name} {decided / (decided + rendered):.0%}")
        planning, rendering = planning + decided, rendering + rendered
    share = planning / (planning + rendering)
    return [
        Figure(
            "planning over planning and pictures, bundled scenes behind 7 patterns, 768 x 512",
            "≤ 1/3",
            f"{share:.0%} of {planning + rendering:.0f} s; {', '.join(shares)}",
            share <= _SHARE_GOAL,
        )
    ]


def _costs(name: str) -> tuple[float, float]:
    """Seconds of processor time for planning and for pictures of a scene."""
    files = replace(BenchFiles.with_defaults(), scene=bundled_path(f"scenes/{name}.toml"))
    camera = read_file(bundled_path("bench.toml"), BenchFile).build_camera()
    scene = read_scene(files)
    world = World(camera, scene.build(), tol=scene.tol, decide_by=scene.decide_by)
    planning = rendering = 0.0
    for target in world.scene.targets:
        world.target = target
        for grey in spreading_patterns(world).values():
            world.grey = grey
            s, began = world.situation(_EXPOSURE), time.process_time()
            plan = world.imaging.plan(s)
            decided = time.process_time()
            world.imaging.electrons(s, plan.recipe)
            planning += decided - began
            rendering += time.process_time() - decided
    return planning, rendering


def ready_plan_figures(folder: Path) -> list[Figure]:
    """Each in a process of its own, on one thread, from the command to the end of the record."""
    told, peaks = [], []
    for name in _PLANS:
        cpu, peak = _run(name, folder / f"{name}.h5")
        told.append(f"{name} {cpu:.1f} s")
        peaks.append(peak)
    return [
        Figure("ready plans, processor time with the start of Python", TOLD, ", ".join(told), None),
        Figure(
            "ready plans, memory at most",
            f"≤ {_MEMORY_GOAL:g} GB each",
            ", ".join(f"{name} {peak:.1f}" for name, peak in zip(_PLANS, peaks, strict=True)),
            max(peaks) <= _MEMORY_GOAL,
        ),
    ]


def _run(name: str, record: Path) -> tuple[float, float]:
    """Processor seconds and gigabytes of `labapp run`.

    The process tells its memory itself: what the system tells counts this one's as well.
    """
    status = record.with_suffix(".status")
    code = (
        "import atexit, pathlib; from labapp.cli import main; "
        f"atexit.register(lambda: pathlib.Path({str(status)!r}).write_text("
        "pathlib.Path('/proc/self/status').read_text())); main()"
    )
    command = [sys.executable, "-c", code, "run", name, "--yes", "--out", str(record)]
    one_thread = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command, env=os.environ | one_thread, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, ended, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(ended)
    if process.returncode:
        raise RuntimeError(f"labapp run {name} ended with {process.returncode}")
    record.unlink()
    (peak,) = re.findall(r"VmHWM:\s*(\d+) kB", status.read_text())
    return usage.ru_utime + usage.ru_stime, int(peak) * 1024 / 1e9


MEASUREMENTS = {"planning": planning_figures, "ready-plans": ready_plan_figures}
