"""`labapp accuracy retrieval`: measure quality against time of every phase retrieval method."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from labapp.accuracy.diagram import draw
from labapp.accuracy.measuring_loop import measure_rows
from labapp.accuracy.row_output import Columns, format_number, print_rows, write_plot
from labapp.accuracy.work_precision import CALLS, ENDLESS, Deadline, Row
from labapp.bench.opening import BenchFiles
from labapp.common.console import terminal_progress
from labapp.common.speed import machine_speed
from labapp.files.bench_file import read_bench
from labapp.files.pattern_table import PSFPattern
from labapp.patterns.grey_levels import target_on_design_grid
from optics.accuracy import MachineSpeed
from optics.camera import Camera
from optics.progress import Progress
from optics.retrieval import METHODS, RetrievalResult, retrieve
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.methods import quick_method
from optics.threads import single_threaded

_ITERATIONS = (3, 10, 30, 100, 300)
_SHORT_S, _REPEATS = 0.5, 3
"""Processor seconds below which a retrieval is timed several times, and how often; chosen."""


@dataclass(frozen=True)
class RetrievalRow(Row):
    """Measured quality and time of a phase retrieval method after a number of iterations.

    error_achieved: NRMSE between PSF and target; there is no exact answer.
    efficiency, contrast: those of `optics.metrics`.
    """

    frames: int = 1
    iterations: int = 0
    efficiency: float | None = None
    contrast: float | None = None


ERROR_NAME = "NRMSE of the shape"

_COLUMNS: Columns[RetrievalRow] = {
    "method": lambda row: row.method,
    "iterations ": lambda row: str(row.iterations),
    "efficiency ": lambda row: "failed" if row.failure else format_number(row.efficiency, ".3f"),
    "contrast ": lambda row: format_number(row.contrast, ".4f"),
    "NRMSE ": lambda row: format_number(row.error_achieved, ".4f"),
    "CPU s ": lambda row: format_number(row.cpu_s, ".2f"),
    "": lambda row: "front" if row.on_front else "",
}
_REMARK = (
    "Of the mean PSF, rounded to the panel's levels, on a grid twice finer than Nyquist; "
    "NRMSE and time decide the front. One thread."
)


def goal_from_options(spec: PSFPattern, bench: Path | None) -> tuple[RetrievalGoal, str]:
    """Return the goal that the options of `labapp accuracy retrieval` describe, and its name.

    Raises UserError for a bench file that is wrong, or a target that can't be drawn.
    """
    return goal_for_camera(spec, read_bench(BenchFiles.with_defaults(bench).bench).build_camera())


def goal_for_camera(spec: PSFPattern, camera: Camera) -> tuple[RetrievalGoal, str]:
    """Return the goal of a target behind a camera, and its name in words."""
    drawing = spec.target.video_drawings(1, Path())[0]
    shape, plane = target_on_design_grid(drawing, camera, spec.wavelength)
    name = f"{spec.target.summary}, {spec.wavelength_nm:g} nm"
    return RetrievalGoal(camera, shape, plane, spec.wavelength), name


@single_threaded
def accuracy_retrieval(
    goal: RetrievalGoal,
    name: str,
    *,
    frames: int,
    budget: float,
    as_json: bool,
    plot: Path | None,
) -> None:
    """Measure quality and time of every phase retrieval method, and print the rows.

    name: the target in words.
    budget: processor seconds that one setting may take.
    """
    with terminal_progress() as progress:
        speed = machine_speed(progress.part(0.0, 0.1))
        rows = measure_retrieval(goal, name, frames, budget, speed, progress.part(0.1, 1.0))
    words = f"{name}, {frames} {'frame' if frames == 1 else 'frames'}"
    print_rows(f"Retrieval: {words}", _COLUMNS, _REMARK, rows, as_json=as_json)
    write_plot(plot, lambda: draw(words, rows, ERROR_NAME))


def measure_retrieval(
    goal: RetrievalGoal,
    name: str,
    frames: int,
    budget: float,
    speed: MachineSpeed,
    progress: Progress,
    deadline: Deadline = ENDLESS,
) -> list[RetrievalRow]:
    """Measure phase retrieval methods that can give so many frames, after more and more iterations.

    budget: processor seconds that one setting may take.
    """
    # This call computes stop, target and FFT plans, so that no method's time includes them.
    _retrieve_once(goal, frames, "published", 1)
    return measure_rows(
        [(row, goal) for row in _empty_rows(goal, name, frames, budget, speed)],
        _measure,
        lambda row: f"{row.method}, {row.iterations} iterations",
        progress,
        deadline,
    )


def _empty_rows(
    goal: RetrievalGoal, name: str, frames: int, budget: float, speed: MachineSpeed
) -> Iterator[RetrievalRow]:
    """Yield the rows to measure within the time budget, the default one marked.

    Each method has one at least.
    """
    slow = goal.camera.panel.response_time > 0
    default = "responding" if slow and frames > 1 else quick_method(frames)
    for method, engine in METHODS.items():
        if not engine.serves(frames) or (method == "responding" and not slow):
            continue
        for iterations in _ITERATIONS:
            predicted = engine.seconds(goal, frames, iterations, speed)
            if iterations == _ITERATIONS[0] or predicted <= budget:
                row = RetrievalRow("retrieval", name, method, "float32", None)
                marks = CALLS[-1:] if (method, iterations) == (default, 100) else ()
                yield replace(row, frames=frames, iterations=iterations, chosen_for=marks)


def _retrieve_once(
    goal: RetrievalGoal, frames: int, method: str, iterations: int
) -> RetrievalResult:
    return retrieve(
        goal.camera,
        goal.target,
        goal.plane,
        goal.wavelength,
        frames=frames,
        method=method,
        iterations=iterations,
        generator=torch.Generator().manual_seed(1),
    )


def _measure(row: RetrievalRow, goal: RetrievalGoal, _: Progress) -> RetrievalRow:
    retrieve_again = partial(_retrieve_once, goal, row.frames, row.method, row.iterations)
    started = time.perf_counter()
    found = retrieve_again()
    wall, times = time.perf_counter() - started, [found.cpu_seconds]
    if found.cpu_seconds < _SHORT_S:
        times += [retrieve_again().cpu_seconds for _ in range(_REPEATS - 1)]
    return replace(
        row,
        error_achieved=found.quality.nrmse,
        efficiency=found.quality.efficiency,
        contrast=found.quality.contrast,
        cpu_s=statistics.median(times),
        wall_s=wall,
        peak_bytes=found.phases.numel() * found.phases.element_size(),
    )
