"""`labapp accuracy deconvolve`: measure quality against time of every restoration method."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure

from labapp.accuracy.blurs import Array, SimulatedPhotograph
from labapp.accuracy.peers import installed_peers
from labapp.accuracy.row_output import (
    Columns,
    describe_machine,
    format_number,
    print_rows,
    write_plot,
)
from labapp.accuracy.work_precision import RetimingSettings, Row, mark_front
from labapp.common.console import terminal_progress
from labapp.common.speed import machine_speed
from optics.accuracy import MachineSpeed
from optics.deconvolution.method import Denoise
from optics.deconvolution.restoration_choice import METHODS, restore
from optics.progress import Progress
from optics.threads import single_threaded

_TIMING = RetimingSettings(short_s=2.0)

_EXTRA_COLOURS = (
    "black",
    "navy",
    "olive",
    "maroon",
    "teal",
    "indigo",
    "peru",
    "lime",
    "gold",
    "crimson",
)


@dataclass(frozen=True)
class DeconvolutionRow(Row):
    """Measured quality and time of a restoration method after a number of iterations.

    The method estimates noise and weights by itself.

    Attributes
    ----------
    error_achieved : float or None
        Relative L2 error of the restored picture.
    iterations : int
        Number of iterations.
    psnr_db, ssim : float or None
        PSNR in dB and SSIM over the whole frame; white is 1.
    inside_db : float or None
        PSNR in dB of the pixels that are further from the border than the PSF is large.
    cpu_predicted_s : float or None
        Predicted processor time in seconds, by which a budget chooses among methods.
    """

    iterations: int = 0
    psnr_db: float | None = None
    inside_db: float | None = None
    ssim: float | None = None
    cpu_predicted_s: float | None = None


_COLUMNS: Columns[DeconvolutionRow] = {
    "method": lambda row: row.method,
    "count ": lambda row: str(row.iterations or ""),
    "PSNR dB ": lambda row: "failed" if row.failure else format_number(row.psnr_db, ".2f"),
    "inside ": lambda row: format_number(row.inside_db, ".2f"),
    "SSIM ": lambda row: format_number(row.ssim, ".3f"),
    "CPU ms ": lambda row: format_number(row.cpu_s, ".1f", 1e3),
    "expected ": lambda row: format_number(row.cpu_predicted_s, ".1f", 1e3),
    "": lambda row: "front" if row.on_front else "",
}
_REMARK = (
    "Noise and weights are estimated, and that is in the time. PSNR of pictures cut to 0 to 1; "
    "inside: further than a PSF from the border. Error and time decide the front. One thread."
)


@single_threaded
def accuracy_deconvolve(
    case: SimulatedPhotograph,
    denoise: Denoise | None,
    *,
    peers: bool,
    as_json: bool,
    plot: Path | None,
) -> None:
    """Measure the accuracy and time of every restoration method, and print the rows.

    `plot` is the file of the diagram, or None for no diagram. `denoise` is the denoiser of
    plug-and-play methods; without one, these methods are left out.
    """
    adapters = installed_peers("deconvolve") if peers else []
    with terminal_progress() as progress:
        speed = machine_speed(progress.part(0.0, 0.1))
        rest = progress.part(0.1, 1.0)
        rows = measure_deconvolution(case, denoise, speed, rest, adapters)
    print_rows(f"Deconvolution: {case.name}", _COLUMNS, _REMARK, rows, as_json=as_json)
    write_plot(plot, lambda: draw(case, rows))


def measure_deconvolution(
    case: SimulatedPhotograph,
    denoise: Denoise | None,
    speed: MachineSpeed,
    progress: Progress,
    adapters: Sequence[Callable[..., Any]] = (),
) -> list[DeconvolutionRow]:
    """Measure the accuracy of every restoration method after more and more iterations.

    Rows that no other row beats in both time and error are marked. A method that fails gives a row,
    too. `adapters` give the methods of other libraries, see `labapp.accuracy.peers`.
    """
    settings = [
        (name, count, partial(_restore_image, case, name, count, denoise))
        for name, method in METHODS.items()
        if denoise is not None or not method.needs_denoiser
        for count in sorted(method.gains)
    ]
    settings += [one for adapter in adapters for one in adapter(case)]
    rows = [_row(case, "as it is", 0, lambda: case.observation)]
    for number, (name, count, solve) in enumerate(settings):
        progress.report(number / len(settings), f"{name}, {count}")
        row = _row(case, name, count, solve)
        if name in METHODS:
            predicted = METHODS[name].seconds(case.problem, count, speed)
            row = replace(row, cpu_predicted_s=predicted)
        rows.append(row)
    return mark_front(rows)


def _restore_image(
    case: SimulatedPhotograph, name: str, count: int, denoise: Denoise | None
) -> torch.Tensor:
    return restore(case.problem, None, name, count=count, denoise=denoise).image


def _row(
    case: SimulatedPhotograph, name: str, count: int, solve: Callable[[], torch.Tensor | Array]
) -> DeconvolutionRow:
    row = DeconvolutionRow("deconvolve", case.name, name, "float32", None, iterations=count)
    times, wall = list[float](), time.perf_counter()
    try:
        while not times or (times[0] < _TIMING.short_s and len(times) < _TIMING.repeats):
            started = time.process_time()
            picture = np.asarray(solve(), dtype=np.float64)
            times.append(time.process_time() - started)
    except ValueError as error:
        return replace(row, failure=str(error))
    decibels, similar = case.quality(picture)
    return replace(
        row,
        error_achieved=float(np.linalg.norm(picture - case.truth) / np.linalg.norm(case.truth)),
        cpu_s=statistics.median(times),
        wall_s=(time.perf_counter() - wall) / len(times),
        psnr_db=decibels,
        inside_db=psnr_away_from_border(case, picture),
        ssim=similar,
    )


def psnr_away_from_border(case: SimulatedPhotograph, picture: Array) -> float | None:
    """Return the PSNR in dB for an accuracy row, without a border as wide as the PSF.

    None if no pixels are left.
    """
    rows, columns = case.psf.shape
    part = slice(rows, -rows), slice(columns, -columns)
    if not case.truth[part].size:
        return None
    left = np.clip(picture[part], 0, 1) - case.truth[part]
    return float(-10 * np.log10(np.mean(left**2)))


def draw(case: SimulatedPhotograph, rows: list[DeconvolutionRow]) -> Figure:
    """Draw the accuracy of each restoration method: curves of PSNR and SSIM against time."""
    figure = Figure(figsize=(13, 5), dpi=110, layout="constrained")
    good = [row for row in rows if not row.failure and row.iterations]
    left, right = figure.subplots(1, 2)
    for number, method in enumerate(dict.fromkeys(row.method for row in good)):
        own = [row for row in good if row.method == method]
        times = [1e3 * (row.cpu_s or 0) for row in own]
        mark = "x--" if method.startswith("scikit") else "o-"
        style = {
            "label": method,
            "color": f"C{number}" if number < 10 else _EXTRA_COLOURS[number % 10],
        }
        left.semilogx(times, [row.psnr_db or 0 for row in own], mark, **style)
        right.semilogx(times, [row.ssim or 0 for row in own], mark, **style)
    before = rows[0]
    for axes, name, value in ((left, "PSNR, dB", before.psnr_db), (right, "SSIM", before.ssim)):
        axes.axhline(value or 0, color="gray", lw=1, ls=":", label="as it is")
        axes.set_title(name, fontsize=10)
        axes.grid(alpha=0.3, which="both")
        axes.set_xlabel("processor time, ms (one thread)")
    figure.legend(*left.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    figure.suptitle(f"{case.name}. {describe_machine()}.", fontsize=9)
    return figure
