"""`labapp accuracy psf`: a work-precision diagram of a lens's PSF as table, JSON and plot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from labapp.accuracy.diagram import draw
from labapp.accuracy.peers import installed_peers
from labapp.accuracy.psf import compare_methods
from labapp.accuracy.regression_check import (
    LESS_ACCURATE,
    SLOWER,
    StoredRows,
    read_stored,
    regression_messages,
    require_comparable_rows,
    slower_rows,
)
from labapp.accuracy.row_output import Columns, format_number, print_rows, write_plot
from labapp.accuracy.work_precision import LONGEST_CALL, MeasurementSet, Row, measure, time_calls
from labapp.common.console import err, out, terminal_progress
from labapp.common.speed import machine_speed
from labapp.prediction.lens_options import LensCase
from optics.accuracy import Budget
from optics.progress import Progress
from optics.threads import single_threaded


@single_threaded
def accuracy_psf(
    case: LensCase,
    *,
    peers: bool,
    as_json: bool,
    plot: Path | None,
    compare: str | None,
) -> None:
    """Measure error and time of every method for a lens's PSF, and print the rows.

    peers: whether other libraries are measured as well, through their installed adapters.
    compare: file of an earlier output of `--json`, or "bundled". The process ends with exit code 1
    if a point has become worse than the stored one.
    """
    stored = read_stored(compare) if compare else None
    adapters = installed_peers("psf") if peers else []
    with terminal_progress() as progress:
        speed = machine_speed(progress.part(0.0, 0.1))
        budget = Budget(speed=speed, seconds=LONGEST_CALL)
        found, truth, similar = compare_methods(case, budget, progress.part(0.1, 0.2), grids=True)
        found += [one for adapter in adapters for one in adapter(case)]
        rest = progress.part(0.2, 0.9 if stored else 1.0)
        measured = measure(found, truth, rest, warm_up=similar)
        worse = _find_regressions(measured, stored, progress.part(0.9, 1.0)) if stored else []
    show_measurements("PSF", case.name, measured, as_json, plot)
    if stored is None:
        return
    where, count = err if as_json else out, require_comparable_rows(measured.rows, stored)
    for line in worse:
        where.print(f"worse than {stored.source}: {line}")
    if worse:
        raise SystemExit(1)
    where.print(
        f"{count} points compared with {stored.source}: none became {100 * SLOWER - 100:.0f} % "
        f"slower, relative to the calibration kernel, or {LESS_ACCURATE:g} times less accurate."
    )


def _find_regressions(
    measurements: MeasurementSet, stored: StoredRows, progress: Progress
) -> list[str]:
    """Return a message for each row that is slower or less accurate than its stored row.

    Rows that look slower are timed twice more, because the machine may have been busy for a moment.
    """
    require_comparable_rows(measurements.rows, stored)
    rows, calibration_s = list(measurements.rows), measurements.calibration_s
    for again in range(2):
        suspects = slower_rows(rows, calibration_s, stored)
        calls = {number: measurements.calls[number] for number in suspects}
        times, calibration_s_now = time_calls(calls, progress.part(again / 2, (again + 1) / 2))
        for number, (cpu, _) in times.items():
            now = cpu / calibration_s_now * calibration_s
            rows[number] = replace(rows[number], cpu_s=min(now, rows[number].cpu_s or now))
    return regression_messages(rows, calibration_s, stored)


_COLUMNS: Columns[Row] = {
    "method": lambda row: row.method if row.tol is not None else f"{row.method}, {row.precision}",
    "asked ": lambda row: format_number(row.tol, ".0e"),
    "achieved ": lambda row: "failed" if row.failure else format_number(row.error_achieved, ".0e"),
    "predicted ": lambda row: format_number(row.error_predicted, ".0e"),
    "first ms ": lambda row: format_number(row.first_answer_s, ".1f", 1e3),
    "CPU ms ": lambda row: format_number(row.cpu_s, ".2f", 1e3),
    "MB ": lambda row: format_number(row.peak_bytes, ".1f", 1e-6),
    "": lambda row: _marks(row),
}
_REMARK = (
    "Relative L2 errors against the exact integral. first: planning and one call. CPU: each "
    "further call. front: nothing is faster per call and more accurate. chosen: by the automatic "
    "choice, for 1 or 100 calls. One thread."
)


def _marks(row: Row) -> str:
    """Return a row's marks in the table: on the front, and chosen for what."""
    front = "front" if row.on_front else ""
    calls = " and ".join(str(count) for count in row.chosen_for)
    return ", ".join(filter(None, (front, f"chosen for {calls}" if calls else "")))


def show_measurements(
    what: str, name: str, measurements: MeasurementSet, as_json: bool, plot: Path | None
) -> None:
    """Print rows as a table or as JSON, and draw their work-precision diagram.

    what, name: what was measured, and for which case.
    """
    rows, kernel = measurements.rows, measurements.calibration_s
    print_rows(f"{what}: {name}", _COLUMNS, _REMARK, rows, as_json=as_json, calibration_s=kernel)
    write_plot(plot, lambda: draw(name, rows))
