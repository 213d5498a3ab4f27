"""`labapp accuracy deconvolve`: measure quality against time of every restoration method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.accuracy.blurs import Array, SimulatedPhotograph
from labapp.accuracy.diagram import draw
from labapp.accuracy.measuring_loop import measure_rows, time_answers
from labapp.accuracy.peers import installed_peers
from labapp.accuracy.row_output import Columns, format_number, print_rows, write_plot
from labapp.accuracy.work_precision import CALLS, CUT, ENDLESS, Deadline, Row, relative_error
from labapp.common.console import terminal_progress
from labapp.common.speed import machine_speed
from optics.accuracy import MachineSpeed
from optics.inverse.choice import DEFAULT_METHOD, METHODS, restore
from optics.inverse.method import Denoise
from optics.inverse.observation import Observation
from optics.progress import Progress
from optics.threads import single_threaded

_SHORT_S = 2.0
"""Processor seconds below which a restoration is timed several times; chosen."""


@dataclass(frozen=True)
class DeconvolutionRow(Row):
    """Measured quality and time of a restoration method after a number of iterations.

    error_achieved: relative L2 error of the restored picture.
    psnr_db, ssim: over the whole frame; white is 1.
    inside_db: PSNR of the pixels that are further from the border than the PSF is large.
    """

    iterations: int = 0
    psnr_db: float | None = None
    inside_db: float | None = None
    ssim: float | None = None


ERROR_NAME = "error of the restored picture, relative L2"

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
    """Measure quality and time of every restoration method, and print the rows.

    denoise: denoiser of plug-and-play methods, which are left out without one.
    """
    adapters = installed_peers("deconvolve") if peers else []
    with terminal_progress() as progress:
        speed = machine_speed(progress.part(0.0, 0.1))
        rest = progress.part(0.1, 1.0)
        rows = measure_deconvolution(case, denoise, speed, rest, adapters)
    print_rows(f"Deconvolution: {case.name}", _COLUMNS, _REMARK, rows, as_json=as_json)
    write_plot(plot, lambda: draw(case.name, rows[1:], ERROR_NAME))


def measure_deconvolution(
    case: SimulatedPhotograph,
    denoise: Denoise | None,
    speed: MachineSpeed,
    progress: Progress,
    adapters: Sequence[Callable[..., Any]] = (),
    deadline: Deadline = ENDLESS,
) -> list[DeconvolutionRow]:
    """Measure every restoration method after more and more iterations.

    The first row is the photograph as it is.
    adapters: give the methods of other libraries, see `labapp.accuracy.peers`.
    """
    settings: list[tuple[str, int, Callable[[], Any]]] = [("as it is", 0, lambda: case.observation)]
    settings += [
        (name, count, partial(_restore_image, case, name, count, denoise))
        for name, method in METHODS.items()
        if denoise is not None or not method.needs_denoiser
        for count in sorted(method.gains)
    ]
    settings += [one for adapter in adapters for one in adapter(case)]
    empty = DeconvolutionRow("deconvolve", case.name, "", "float32", None)
    rows = measure_rows(
        [(replace(empty, method=name, iterations=n), solve) for name, n, solve in settings],
        partial(_measure, case),
        lambda row: f"{row.method}, {row.iterations}",
        progress,
        deadline,
    )
    problem = case.problem
    return [_with_prediction(row, problem, speed) for row in rows]


def _with_prediction(
    row: DeconvolutionRow, problem: Observation, speed: MachineSpeed
) -> DeconvolutionRow:
    """Return the row of one of our methods with its expected time, the usual one marked."""
    if row.method not in METHODS or row.failure == CUT:
        return row
    method = METHODS[row.method]
    usual = row.method == DEFAULT_METHOD and row.iterations == method.default_iterations(problem)
    return replace(
        row,
        cpu_predicted_s=method.seconds(problem, row.iterations, speed),
        chosen_for=CALLS[-1:] if usual else (),
    )


def _restore_image(
    case: SimulatedPhotograph, name: str, count: int, denoise: Denoise | None
) -> torch.Tensor:
    return restore(case.problem, None, name, count=count, denoise=denoise).image


def _measure(
    case: SimulatedPhotograph, row: DeconvolutionRow, solve: Callable[[], Any], _: Progress
) -> DeconvolutionRow:
    picture, cpu, wall = time_answers(lambda: np.asarray(solve(), dtype=np.float64), _SHORT_S)
    decibels, similar = case.quality(picture)
    return replace(
        row,
        error_achieved=relative_error(picture, case.truth),
        cpu_s=cpu,
        wall_s=wall,
        psnr_db=decibels,
        inside_db=psnr_away_from_border(case, picture),
        ssim=similar,
    )


def psnr_away_from_border(case: SimulatedPhotograph, picture: Array) -> float | None:
    """Return the PSNR in dB without a border as wide as the PSF; None if no pixels are left."""
    rows, columns = case.psf.shape
    part = slice(rows, -rows), slice(columns, -columns)
    if not case.truth[part].size:
        return None
    left = np.clip(picture[part], 0, 1) - case.truth[part]
    return float(-10 * np.log10(np.mean(left**2)))
