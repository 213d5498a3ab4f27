"""Measuring and showing a work-precision diagram: table, JSON, plot."""

from __future__ import annotations

import io
import json
from dataclasses import asdict
from pathlib import Path

import torch
from matplotlib.figure import Figure

from labapp.accuracy.psf import Case, candidates
from labapp.accuracy.rows import Row, measure
from labapp.console import out, table, watched
from labapp.figures import machine
from labapp.files.writing import require_writable, write_whole


def accuracy_psf(case: Case, *, data: Path | None, plot: Path | None, force: bool) -> None:
    """Measure every method for a case, print the table, and write rows and plot if asked."""
    for path in (data, plot):
        if path is not None:
            require_writable(path, force=force)
    with watched() as progress:
        progress.report(0.0, "the exact integral")
        truth = case.truth()
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            rows = measure(list(candidates(case)), truth, progress)
        finally:
            torch.set_num_threads(before)
    _print(case, rows)
    if data is not None:
        found = {"machine": machine(), "rows": [asdict(row) for row in rows]}
        write_whole(data, json.dumps(found, indent=2).encode())
        out.print(f"wrote {data}")
    if plot is not None:
        buffer = io.BytesIO()
        draw(case, rows).savefig(buffer, format=plot.suffix.lstrip(".") or "png")
        write_whole(plot, buffer.getvalue())
        out.print(f"wrote {plot}")


def _print(case: Case, rows: list[Row]) -> None:
    columns = ["method", "asked ", "achieved ", "predicted ", "CPU ms ", "MB ", ""]
    cells = [
        [
            row.method if row.tol is not None else f"{row.method}, {row.precision}",
            _number(row.tol),
            "failed" if row.failure else _number(row.error_achieved),
            _number(row.error_predicted),
            "" if row.cpu_s is None else f"{1e3 * row.cpu_s:.2f}",
            "" if row.peak_bytes is None else f"{row.peak_bytes / 1e6:.1f}",
            "front" if row.on_front else "",
        ]
        for row in rows
    ]
    table(f"PSF: {case.name}", columns, cells)
    for failure in dict.fromkeys(row.failure for row in rows if row.failure):
        out.print(f"failed: {failure}", markup=False)
    out.print("Relative L2 errors against the exact integral; one thread, planning left out.")
    out.print(machine(), style="dim")


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.0e}"


def draw(case: Case, rows: list[Row]) -> Figure:
    """Error against time, a curve a method; what failed stands in the caption."""
    figure = Figure(figsize=(9, 6), dpi=110, layout="constrained")
    axes = figure.subplots()
    good = [row for row in rows if not row.failure]
    for family in dict.fromkeys(_family(row) for row in good):
        line = [row for row in good if _family(row) == family]
        times = [1e3 * (row.cpu_s or 0) for row in line]
        axes.loglog(times, [row.error_achieved or 0 for row in line], "o-", label=family)
    failed = len(rows) - len(good)
    axes.set_xlabel(
        "processor time of one call, ms (one thread)\n"
        f"{machine()}. Reference: the exact integral. {failed} of {len(rows)} settings failed."
    )
    axes.set_ylabel("achieved error, relative L2")
    axes.set_title(case.name, fontsize=10)
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    return figure


def _family(row: Row) -> str:
    """A method without its setting."""
    if row.tol is not None:
        return row.method
    return f"grid, {row.method.partition(', ')[2]}, {row.precision}"
