"""`labapp accuracy hdr`: measure the error and time of merges of exposure brackets."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.accuracy.hdr_case import BracketCase
from labapp.accuracy.hdr_diagram import MergeRow, draw_merges
from labapp.accuracy.measuring_loop import measure_rows, time_answers
from labapp.accuracy.row_output import Columns, format_number, print_rows, write_plot
from labapp.accuracy.work_precision import CALLS, ENDLESS, Deadline
from labapp.common.console import terminal_progress
from optics import hdr
from optics.progress import Progress
from optics.threads import single_threaded

Array = NDArray[np.float64]

_SHORT_S = 1.0
"""Processor seconds below which a merge is timed several times; chosen."""

_SURE = 3.0
"""Standard errors from which on a mean error counts as bias."""

_FAR_OFF = 10.0
"""Relative error from which on a merge counts as failed. Chosen."""

_OPENCV_MERGES: dict[str, tuple[Callable[[], Any], Callable[[], Any]]] = {
    "Debevec": (cv2.createCalibrateDebevec, cv2.createMergeDebevec),
    "Robertson": (cv2.createCalibrateRobertson, cv2.createMergeRobertson),
}
"""OpenCV's merges of exposure brackets, with what they calibrate the response curve by: Debevec and
Malik, SIGGRAPH 1997, doi 10.1145/258734.258884; Robertson, Borman, Stevenson, ICIP 1999, doi
10.1109/ICIP.1999.817091."""

_COLUMNS: Columns[MergeRow] = {
    "exposures": lambda row: f"{row.frames}, {row.exposure_s:.3g} s",
    "method": lambda row: row.method,
    "error ": lambda row: "failed" if row.failure else format_number(row.error_achieved, ".2g"),
    "of best ": lambda row: format_number(row.efficiency, ".2f"),
    "least ": lambda row: format_number(row.least_efficiency, ".2f"),
    "bias ": lambda row: format_number(row.bias, ".1g"),
    "CPU ms ": lambda row: format_number(row.cpu_s, ".1f", 1e3),
    "": lambda row: "front" if row.on_front else "",
}
_REMARK = (
    "Errors are relative, rms over all levels of light alike. of best: least variance of any "
    "unbiased estimate over the mean squared error; least: at the worst level. bias: largest mean "
    "error that isn't chance. OpenCV sees the frames' upper eight bits, and its scale is fitted. "
    "One thread."
)


@single_threaded
def accuracy_hdr(cases: Sequence[BracketCase], *, as_json: bool, plot: Path | None) -> None:
    """Measure error and time of every merge of brackets, and print the rows."""
    with terminal_progress() as progress:
        rows = measure_merges(cases, progress)
    name = cases_name(cases)
    print_rows(f"Merged brackets: {name}", _COLUMNS, _REMARK, rows, as_json=as_json)
    write_plot(plot, lambda: draw_merges(name, rows))


def cases_name(cases: Sequence[BracketCase]) -> str:
    """Describe brackets in words."""
    first, last = cases[0], cases[-1]
    count = f"{first.frames} to {last.frames}" if len(cases) > 1 else str(first.frames)
    return f"{count}{first.name.removeprefix(str(first.frames))}"


def measure_merges(
    cases: Sequence[BracketCase], progress: Progress, deadline: Deadline = ENDLESS
) -> list[MergeRow]:
    """Measure every merge of each bracket."""
    cases_and_merges = [(row, (case, merge)) for case in cases for row, merge in _merges(case)]
    return measure_rows(cases_and_merges, _measure, lambda row: row.case, progress, deadline)


Merge = Callable[[], tuple[Array, Array | None]]
"""Returns rates, (levels, pixels), and their stated variances, or None."""


def _merges(case: BracketCase) -> Iterator[tuple[MergeRow, Merge]]:
    """Yield the merges of a bracket, each with the row that it is to fill."""
    row = MergeRow(
        "hdr", case.name, "", "float32", None, frames=case.frames, exposure_s=sum(case.times)
    )
    for method in hdr.METHODS:
        chosen = CALLS[-1:] if method == hdr.METHODS[-1] else ()
        yield replace(row, method=method, chosen_for=chosen), partial(_merge, case, method)
    for name in _OPENCV_MERGES:
        opencv = replace(row, method=f"OpenCV {name}", precision="8 bit")
        yield opencv, partial(_merge_by_opencv, case, name)


def _merge(case: BracketCase, method: hdr.Method) -> tuple[Array, Array | None]:
    found = hdr.merge(case.bracket, method)
    return found.rate.double().numpy(), found.variance.double().numpy()


def _merge_by_opencv(case: BracketCase, name: str) -> tuple[Array, Array | None]:
    """Merge by OpenCV, with the scale that fits best.

    It takes pictures of three colours and eight bits, which are the upper ones of the frames.
    """
    bracket = case.bracket
    shift = max(bracket.sensor.bits - 8, 0)
    frames = [
        cv2.merge([(np.asarray(one).astype(np.uint16) >> shift).astype(np.uint8)] * 3)
        for one in bracket.frames
    ]
    calibrate, merge = _OPENCV_MERGES[name]
    times = bracket.times.astype(np.float32)
    merged = merge().process(frames, times, calibrate().process(frames, times))
    light = np.asarray(merged[..., 0], dtype=np.float64)
    scale = np.median(light / case.rates[:, None])
    return light / (scale if scale > 0 else 1.0), None


def _measure(row: MergeRow, merging: tuple[BracketCase, Merge], _: Progress) -> MergeRow:
    """Measure a merge's error, time, efficiency and bias."""
    case, merge = merging
    try:
        (rates, variance), cpu, wall = time_answers(merge, _SHORT_S)
    except (ValueError, cv2.error) as error:
        raise ValueError(f"{row.method}: {' '.join(str(error).split())}") from error
    if not np.isfinite(rates).all():
        raise ValueError(f"{row.method}: has light that isn't finite, of dark pixels")
    away = rates / case.rates[:, None] - 1
    squares, mean = (away**2).mean(axis=1), away.mean(axis=1)
    chance = _SURE * away.std(axis=1) / np.sqrt(away.shape[1])
    reached = float(np.sqrt(squares.mean()))
    if reached > _FAR_OFF:
        raise ValueError(f"{row.method}: its light is far off, by {reached:.0e} times")
    least = case.least_errors**2
    stated = None if variance is None else (variance / case.rates[:, None] ** 2).mean()
    return replace(
        row,
        error_achieved=reached,
        error_predicted=None if stated is None else float(np.sqrt(stated)),
        cpu_s=cpu,
        wall_s=wall,
        peak_bytes=sum(np.asarray(one).nbytes for one in case.bracket.frames) + rates.nbytes,
        efficiency=float(least.sum() / squares.sum()),
        least_efficiency=float((least / squares).min()),
        bias=float(np.where(np.abs(mean) > chance, np.abs(mean), 0).max()),
    )
