"""`labapp accuracy psf`: measure a work-precision diagram and show it as table, JSON and plot."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Console

from labapp.accuracy.peers import installed_peers
from labapp.accuracy.psf import candidates, exact_psf
from labapp.accuracy.regression_check import (
    LESS_ACCURATE,
    SLOWER,
    StoredRows,
    read_stored,
    regression_messages,
    require_comparable_rows,
    slower_rows,
)
from labapp.accuracy.row_output import (
    Columns,
    describe_machine,
    format_number,
    print_rows,
    write_plot,
)
from labapp.accuracy.work_precision import MeasurementSet, Row, measure, time_calls
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
    """Measure the accuracy and time of every method for a lens's PSF, and print the rows.

    Parameters
    ----------
    case : LensCase
        Lens, object, wavelength and window.
    peers : bool
        Whether other libraries are measured as well, through their installed adapters.
    as_json : bool
        Whether the rows are printed as JSON instead of as a table.
    plot : Path or None
        File of the diagram; None for no diagram.
    compare : str or None
        File of an earlier output of `--json`, or "bundled". The process ends with exit code 1 if
        a point has become worse than the stored one.
    """
    stored = read_stored(compare) if compare else None
    adapters = installed_peers("psf") if peers else []
    with terminal_progress() as progress:
        speed = machine_speed(progress.part(0.0, 0.1))
        truth = exact_psf(case, progress.part(0.1, 0.2))
        found = list(candidates(case, Budget(speed=speed)))
        found += [one for adapter in adapters for one in adapter(case)]
        measured = measure(found, truth, progress.part(0.2, 0.9 if stored else 1.0))
        worse = _find_regressions(measured, stored, progress.part(0.9, 1.0)) if stored else []
    show_measurements("PSF", case.name, measured, as_json, plot)
    if stored is not None:
        _report_regressions(
            worse, require_comparable_rows(measured.rows, stored), stored, err if as_json else out
        )


def _find_regressions(
    measurements: MeasurementSet, stored: StoredRows, progress: Progress
) -> list[str]:
    """Return a message for each accuracy row that is slower or less accurate than its stored row.

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


def _report_regressions(worse: list[str], count: int, stored: StoredRows, where: Console) -> None:
    """Print the accuracy rows that became worse, and exit with code 1 if there are any."""
    for line in worse:
        where.print(f"worse than {stored.source}: {line}", markup=False)
    if worse:
        raise SystemExit(1)
    percent = 100 * SLOWER - 100
    where.print(
        f"{count} points compared with {stored.source}: none became {percent:.0f} % slower, "
        f"relative to the calibration kernel, or {LESS_ACCURATE:g} times less accurate."
    )


_SIZE = re.compile(r"\d+² ")
"""Grid size in the name of a method; it names a point of a curve and not the curve."""

_COMMON_WORDS = ("pupil", "gray edge")
"""Words in the names of methods that curves leave out."""


_COLUMNS: Columns[Row] = {
    "method": lambda row: row.method if row.tol is not None else f"{row.method}, {row.precision}",
    "asked ": lambda row: format_number(row.tol, ".0e"),
    "achieved ": lambda row: "failed" if row.failure else format_number(row.error_achieved, ".0e"),
    "predicted ": lambda row: format_number(row.error_predicted, ".0e"),
    "CPU ms ": lambda row: format_number(row.cpu_s, ".2f", 1e3),
    "MB ": lambda row: format_number(row.peak_bytes, ".1f", 1e-6),
    "": lambda row: "front" if row.on_front else "",
}
_REMARK = "Relative L2 errors against the exact integral; one thread, planning left out."


def show_measurements(
    what: str, name: str, measurements: MeasurementSet, as_json: bool, plot: Path | None
) -> None:
    """Print the rows of a work-precision diagram as a table or as JSON, and draw the diagram.

    `what` and `name` say what was measured and for which case. `plot` is the file of the diagram,
    or None for no diagram.
    """
    rows, kernel = measurements.rows, measurements.calibration_s
    print_rows(f"{what}: {name}", _COLUMNS, _REMARK, rows, as_json=as_json, calibration_s=kernel)
    write_plot(plot, lambda: draw(name, rows))


def draw(name: str, rows: list[Row]) -> Figure:
    """Draw a work-precision diagram: error against time, one curve for each method.

    The caption counts the failures.
    """
    figure = Figure(figsize=(9, 6), dpi=110, layout="constrained")
    axes = figure.subplots()
    good = [row for row in rows if not row.failure]
    for family in dict.fromkeys(_curve_name(row) for row in good):
        line = [row for row in good if _curve_name(row) == family]
        times = [1e3 * (row.cpu_s or 0) for row in line]
        axes.loglog(times, [row.error_achieved or 0 for row in line], "o-", label=family)
    failed = len(rows) - len(good)
    axes.set_xlabel(
        "processor time of one call, ms (one thread)\n"
        f"{describe_machine()}. Reference: the exact integral. "
        f"{failed} of {len(rows)} settings failed."
    )
    axes.set_ylabel("achieved error, relative L2")
    axes.set_title(name, fontsize=10)
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    return figure


def _curve_name(row: Row) -> str:
    """Return the name of a row's curve in the work-precision diagram.

    The name is the row's method. If the row has no tolerance, the name leaves out the grid size and
    common words, and adds the precision.
    """
    if row.tol is not None:
        return row.method
    words = [_SIZE.sub("", word) for word in row.method.split(", ")]
    words = [word for word in words if word not in _COMMON_WORDS]
    return ", ".join([*words, row.precision])
