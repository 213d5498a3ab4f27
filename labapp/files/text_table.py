"""Read tables of numbers in text files, as vendors and spreadsheets write them."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from labapp.files.reading import read_text


def table_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return the numbered lines of a text table's file, split into cells.

    The separator is a semicolon if there is any in the file, else a comma, else blanks. Text after
    # is a comment, and empty lines are left out. Raises UserError if the file isn't text.
    """
    text = read_text(path, "a table as CSV")
    plain = ((k, line.split("#", 1)[0].strip()) for k, line in enumerate(text.splitlines(), 1))
    kept = [(k, line) for k, line in plain if line]
    separator = next((one for one in ";," if any(one in line for _, line in kept)), None)
    rows: Iterable[list[str]] = (
        csv.reader((line for _, line in kept), delimiter=separator)
        if separator
        else (line.split() for _, line in kept)
    )
    return [(k, [cell.strip() for cell in row]) for (k, _), row in zip(kept, rows, strict=True)]


def parse_numbers(cells: list[str]) -> list[float] | None:
    """Parse the numbers in a text table's cells; None if a cell holds something else."""
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        return None
