"""Prints measured rows as a table or JSON, and writes their diagram as a picture."""

from __future__ import annotations

import io
import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from matplotlib.figure import Figure

from labapp.common.console import out, print_json, print_message, print_table
from labapp.common.figure_png import show_plain_text
from labapp.files.writing import write_atomically

R = TypeVar("R")

Columns = Mapping[str, Callable[[R], str]]
"""Functions that format a row's cell, by the heading of its column, which ends in a blank where the
column holds numbers."""


def print_rows(
    title: str, columns: Columns[R], remark: str, rows: Sequence[R], *, as_json: bool, **more: float
) -> None:
    """Print rows as a table with the reasons of failures, or as JSON, which also holds `more`."""
    if as_json:
        print_data(rows, **more)
        return
    print_table(title, list(columns), [[cell(row) for cell in columns.values()] for row in rows])
    failures = (getattr(row, "failure", "") for row in rows)
    for failure in dict.fromkeys(filter(None, failures)):
        out.print(f"failed: {failure}")
    out.print(remark)
    out.print(describe_machine(), style="dim")


def format_number(value: float | None, form: str, scale: float = 1.0) -> str:
    """Format `scale` times a number; None gives empty text."""
    return "" if value is None else format(scale * value, form)


def print_data(rows: Sequence[Any], **more: float) -> None:
    """Print rows, which are dataclasses, as JSON with the machine and further numbers."""
    print_json({"machine": describe_machine(), **more, "rows": [row_data(row) for row in rows]})


def row_data(row: Any) -> dict[str, Any]:
    """Return a row, a dataclass, as plain data; JSON has no infinity, which becomes null."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in asdict(row).items()
    }


def write_plot(plot: Path | None, draw: Callable[[], Figure]) -> None:
    """Write a diagram to a file in the format of its ending; do nothing for None."""
    if plot is None:
        return
    buffer = io.BytesIO()
    figure = draw()
    show_plain_text(figure)
    figure.savefig(buffer, format=plot.suffix.lstrip(".") or "png")
    write_atomically(plot, buffer.getvalue())
    print_message(f"wrote {plot}")


def describe_machine() -> str:
    """Describe processor, number of cores and version of Python in one line."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.partition(":")[2].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        pass
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"
