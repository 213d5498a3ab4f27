"""`labapp accuracy multispectral`: measure quality against time of restored spectral bands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from labapp.accuracy.diagram import draw
from labapp.accuracy.measuring_loop import measure_rows, time_answers
from labapp.accuracy.row_output import Columns, format_number, print_rows, write_plot
from labapp.accuracy.spectral_case import SpectralCase
from labapp.accuracy.work_precision import CALLS, CUT, ENDLESS, Deadline, Row, relative_error
from labapp.common.console import print_message, terminal_progress
from optics.multispectral import restore_by_published_objective, restore_spectra
from optics.progress import Progress
from optics.threads import single_threaded

_SHORT_S = 2.0
"""Processor seconds below which a restoration is timed several times; chosen."""

_COUNTS = (10, 20, 50, 100, 200)
_PUBLISHED_COUNTS = (30, 100, 300)
"""Numbers of iterations that are measured; chosen."""

_USUAL_COUNT = 100
"""Number of iterations of `restore_spectra`, unless one is given."""

_ADAPTS, _STAYS, _PUBLISHED = (
    "typical spectra, adapting",
    "typical spectra",
    "published objective",
)


@dataclass(frozen=True)
class MultispectralRow(Row):
    """Measured quality and time of restored spectral bands after a number of iterations.

    error_achieved: relative L2 error of all bands.
    psnr_db, least_db: mean PSNR of the bands, and that of the worst band; white is 1.
    """

    iterations: int = 0
    psnr_db: float | None = None
    least_db: float | None = None


ERROR_NAME = "error of the restored bands, relative L2"

_COLUMNS: Columns[MultispectralRow] = {
    "method": lambda row: row.method,
    "count ": lambda row: str(row.iterations),
    "PSNR dB ": lambda row: "failed" if row.failure else format_number(row.psnr_db, ".2f"),
    "worst ": lambda row: format_number(row.least_db, ".2f"),
    "CPU ms ": lambda row: format_number(row.cpu_s, ".0f", 1e3),
    "": lambda row: "front" if row.on_front else "",
}
_REMARK = (
    "PSNR: mean of the bands, cut to 0 to 1, and that of the worst band. Weights are chosen from "
    "the snapshot; those of the published objective are fixed. Error and time decide the front. "
    "One thread."
)


@single_threaded
def accuracy_multispectral(case: SpectralCase, *, as_json: bool, plot: Path | None) -> None:
    """Measure quality and time of restorations of spectral bands, and print the rows."""
    with terminal_progress() as progress:
        rows = measure_multispectral(case, progress)
    for note in () if as_json else case.notes:
        print_message(f"note: {note}")
    print_rows(f"Spectral bands: {case.name}", _COLUMNS, _REMARK, rows, as_json=as_json)
    write_plot(plot, lambda: draw(case.name, rows, ERROR_NAME))


def measure_multispectral(
    case: SpectralCase, progress: Progress, deadline: Deadline = ENDLESS
) -> list[MultispectralRow]:
    """Measure restored spectral bands after more and more iterations."""
    empty = MultispectralRow("multispectral", case.name, "", "float32", None)
    rows = measure_rows(
        [(replace(empty, method=name, iterations=n), solve) for name, n, solve in _settings(case)],
        partial(_measure, case),
        lambda row: f"{row.method}, {row.iterations}",
        progress,
        deadline,
    )
    usual = (_ADAPTS, _USUAL_COUNT)
    return [
        replace(row, chosen_for=CALLS[-1:])
        if (row.method, row.iterations) == usual and row.failure != CUT
        else row
        for row in rows
    ]


def _settings(case: SpectralCase) -> list[tuple[str, int, Callable[[], Any]]]:
    """Return the restorations to measure: name, iterations, function.

    Short ones come first, so that a deadline cuts the long ones.
    """
    seen, spectra = case.snapshot.observation, case.spectra
    settings: list[tuple[str, int, Callable[[], Any]]] = []
    for adapts, name in ((False, _STAYS), (True, _ADAPTS)):
        settings += [
            (name, n, partial(restore_spectra, seen, spectra, iterations=n, adapts=adapts))
            for n in _COUNTS
        ]
    settings += [
        (_PUBLISHED, n, partial(restore_by_published_objective, seen, iterations=n))
        for n in _PUBLISHED_COUNTS
    ]
    return sorted(settings, key=lambda one: one[1])


def _measure(
    case: SpectralCase, row: MultispectralRow, solve: Callable[[], Any], _: Progress
) -> MultispectralRow:
    """Measure error and time of one restoration."""
    bands, cpu, wall = time_answers(lambda: np.asarray(solve().image, np.float64), _SHORT_S)
    levels = case.snapshot.band_levels(bands)
    return replace(
        row,
        error_achieved=relative_error(bands, case.snapshot.truth),
        cpu_s=cpu,
        wall_s=wall,
        psnr_db=float(np.mean(levels)),
        least_db=min(levels),
    )
