"""Read tables of numbers in text files, as vendors and spreadsheets write them."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from labapp.common.errors import UserError
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
    return [(k, _split(path, k, line, separator)) for k, line in kept]


def _split(path: Path, number: int, line: str, separator: str | None) -> list[str]:
    """Return the cells of a line of a text table; a cell in quotes ends on its line."""
    if separator is None:
        return line.split()
    try:
        (row,) = csv.reader([line], delimiter=separator)
    except csv.Error as error:
        raise UserError(f"{path}, line {number}: cannot be split into cells: {error}.") from error
    return [cell.strip() for cell in row]


def parse_numbers(cells: list[str]) -> list[float] | None:
    """Parse the numbers in a text table's cells; None if a cell holds no finite number."""
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None
