"""`labapp accuracy retrieval`: measure quality against time of every phase retrieval method."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from matplotlib.figure import Figure

from labapp.accuracy.row_output import (
    Columns,
    describe_machine,
    format_number,
    print_rows,
    write_plot,
)
from labapp.accuracy.work_precision import RetimingSettings, Row, mark_front
from labapp.bench.opening import BenchFiles
from labapp.common.console import terminal_progress
from labapp.common.speed import machine_speed
from labapp.files.bench_file import read_bench
from labapp.files.pattern_table import PSFPattern
from labapp.patterns.grey_levels import target_on_design_grid
from optics.accuracy import MachineSpeed
from optics.progress import Progress
from optics.retrieval import METHODS, RetrievalResult, retrieve
from optics.retrieval.goal import RetrievalGoal
from optics.threads import single_threaded

_ITERATIONS = (3, 10, 30, 100, 300)
_TIMING = RetimingSettings(short_s=0.5)


@dataclass(frozen=True)
class RetrievalRow(Row):
    """Measured quality and time of a phase retrieval method after a number of iterations.

    `error_achieved` is the NRMSE between PSF and target. `tol` is None, because retrieval has no
    exact answer. `efficiency` and `contrast` are those of `optics.metrics`. `frames` is the number
    of frames of the video.
    """

    frames: int = 1
    iterations: int = 0
    efficiency: float | None = None
    contrast: float | None = None


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
    """Return the retrieval goal that the options of `labapp accuracy retrieval` describe.

    The second value is its name in words. Raises UserError for a bench file that is wrong, or a
    target that can't be drawn.
    """
    camera = read_bench(BenchFiles.with_defaults(bench).bench).build_camera()
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
    """Measure the accuracy and time of every phase retrieval method, and print the rows.

    `name` is the target in words. `budget` is the processor time in seconds that one setting may
    take. `plot` is the file of the diagram, or None for no diagram.
    """
    with terminal_progress() as progress:
        speed = machine_speed(progress.part(0.0, 0.1))
        rows = measure_retrieval(goal, name, frames, budget, speed, progress.part(0.1, 1.0))
    print_rows(f"Retrieval: {_case(name, rows)}", _COLUMNS, _REMARK, rows, as_json=as_json)
    write_plot(plot, lambda: draw(name, rows))


def measure_retrieval(
    goal: RetrievalGoal,
    name: str,
    frames: int,
    budget: float,
    speed: MachineSpeed,
    progress: Progress,
) -> list[RetrievalRow]:
    """Measure the accuracy of every phase retrieval method that can give so many frames.

    Each method is measured after more and more iterations. Rows that no other row beats in both
    time and error are marked. A method that refuses the target gives a row with the reason.
    `budget` is the processor time in seconds that one setting may take.
    """
    # This call computes stop, target and FFT plans, so that no method's time includes them.
    _retrieve_once(goal, frames, "published", 1)
    settings = list(_settings(goal, frames, budget, speed))
    rows = []
    for number, (method, iterations) in enumerate(settings):
        progress.report(number / len(settings), f"{method}, {iterations} iterations")
        rows.append(_measure_method(goal, name, frames, method, iterations))
    return mark_front(rows)


def _settings(
    goal: RetrievalGoal, frames: int, budget: float, speed: MachineSpeed
) -> Iterator[tuple[str, int]]:
    """Yield each accuracy row's retrieval method and number of iterations, within the time budget.

    Each method comes at least once.
    """
    slow = goal.camera.panel.response_time > 0
    for name, method in METHODS.items():
        if not method.serves(frames) or (name == "responding" and not slow):
            continue
        for iterations in _ITERATIONS:
            predicted = method.seconds(goal, frames, iterations, speed)
            if iterations == _ITERATIONS[0] or predicted <= budget:
                yield name, iterations


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


def _measure_method(
    goal: RetrievalGoal, name: str, frames: int, method: str, iterations: int
) -> RetrievalRow:
    row = RetrievalRow(
        "retrieval", name, method, "float32", None, frames=frames, iterations=iterations
    )
    started = time.perf_counter()
    try:
        found = _retrieve_once(goal, frames, method, iterations)
    except ValueError as error:
        return replace(row, failure=str(error))
    wall, times = time.perf_counter() - started, [found.cpu_seconds]
    if found.cpu_seconds < _TIMING.short_s:
        times += [
            _retrieve_once(goal, frames, method, iterations).cpu_seconds
            for _ in range(_TIMING.repeats - 1)
        ]
    quality = found.quality
    return replace(
        row,
        error_achieved=quality.nrmse,
        efficiency=quality.efficiency,
        contrast=quality.contrast,
        cpu_s=statistics.median(times),
        wall_s=wall,
        peak_bytes=found.phases.numel() * found.phases.element_size(),
    )


def _case(name: str, rows: Sequence[RetrievalRow]) -> str:
    frames = rows[0].frames
    return f"{name}, {frames} {'frame' if frames == 1 else 'frames'}"


def draw(name: str, rows: list[RetrievalRow]) -> Figure:
    """Draw retrieval methods' accuracy against time: error, speckle contrast and lost light."""
    figure = Figure(figsize=(12, 5), dpi=110, layout="constrained")
    good = [row for row in rows if not row.failure]
    shown = {
        "NRMSE of the shape": [row.error_achieved or 0 for row in good],
        "speckle contrast": [row.contrast or 0 for row in good],
        "light beside the target": [1 - (row.efficiency or 0) for row in good],
    }
    for axes, (title, values) in zip(figure.subplots(1, 3), shown.items(), strict=True):
        for method in dict.fromkeys(row.method for row in good):
            line = [number for number, row in enumerate(good) if row.method == method]
            times = [good[number].cpu_s or 0 for number in line]
            axes.loglog(times, [values[number] for number in line], "o-", label=method)
        axes.set_title(title, fontsize=10)
        axes.grid(alpha=0.3, which="both")
        axes.set_xlabel("processor time, s (one thread)")
    axes.legend(fontsize=8)
    failed = len(rows) - len(good)
    figure.suptitle(
        f"{_case(name, rows)}. {describe_machine()}. {failed} of {len(rows)} settings failed.",
        fontsize=9,
    )
    return figure
