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
"""Functions that format a row's cell, by the heading of its column.

A heading that ends in a blank belongs to a column of numbers.
"""


def print_rows(
    title: str, columns: Columns[R], remark: str, rows: Sequence[R], *, as_json: bool, **more: float
) -> None:
    """Print rows as a table, with the reasons of failures, or as JSON.

    more: further numbers that only the JSON holds.
    """
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
    """Print rows, which are dataclasses, as JSON with the machine and further numbers.

    JSON has no infinity, so that a number that isn't finite becomes null.
    """
    told = [{name: _finite(value) for name, value in asdict(row).items()} for row in rows]
    print_json({"machine": describe_machine(), **more, "rows": told})


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
