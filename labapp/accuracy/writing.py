"""Measured rows as JSON, and their diagram as a picture."""

from __future__ import annotations

import io
import math
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from labapp.accuracy.rows import Row
from labapp.common.console import out, print_json, say, table
from labapp.files.writing import write_whole


def print_data(rows: Sequence[Any], **more: float) -> None:
    """Dataclasses as JSON, with the machine's name and what else there is.

    JSON has no infinity: a number that isn't finite is null.
    """
    told = [{name: _finite(value) for name, value in asdict(row).items()} for row in rows]
    print_json({"machine": machine(), **more, "rows": told})


def show_rows(
    heading: str,
    columns: Sequence[str],
    cells: Sequence[Sequence[str]],
    rows: Sequence[Row],
    note: str,
) -> None:
    """A table of measured rows, why some failed, what the figures are, and the machine."""
    table(heading, columns, cells)
    for failure in dict.fromkeys(row.failure for row in rows if row.failure):
        out.print(f"failed: {failure}", markup=False)
    out.print(note)
    out.print(machine(), style="dim")


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_plot(plot: Path | None, draw: Callable[[], Figure]) -> None:
    """The diagram in the format that the path's ending says, if there is one."""
    if plot is None:
        return
    buffer = io.BytesIO()
    draw().savefig(buffer, format=plot.suffix.lstrip(".") or "png")
    write_whole(plot, buffer.getvalue())
    say(f"wrote {plot}")


def machine() -> str:
    """The machine in a line, for the caption of figures."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.partition(":")[2].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        pass
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"
