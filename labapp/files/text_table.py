"""Tables of numbers in text files, as vendors and spreadsheets write them."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from labapp.files.reading import read_text


def table_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Numbered lines that say something, in cells, which semicolons part, or else commas, or
    else blanks. Lines from # on are remarks. UserError for a file without text.
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
    """The numbers in cells; None if one holds something else."""
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        return None
