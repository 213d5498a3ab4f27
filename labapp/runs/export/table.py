"""The table of the frames that comes with every kind."""

from __future__ import annotations

import csv
from pathlib import Path

from labapp.runs.export.naming import SINGLE, TABLE
from labapp.runs.export.rows import heading
from labapp.runs.export.work import Work


def write_table(work: Work, draft: Path) -> None:
    """A line a frame: its file, its place in it, all columns, and what was simulated."""
    simulated = " ".join(work.record.simulated)
    with (draft / TABLE).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        headings = [heading(name) for name in work.rows[0]]
        writer.writerow(["file", "place", *headings, "simulated"])
        for place, row in enumerate(work.rows):
            at = (work.names[place], 0) if work.kind in SINGLE else (work.names[0], place)
            writer.writerow([*at, *row.values(), simulated])
