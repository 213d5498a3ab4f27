"""Tables of numbers as text, as vendors and spreadsheets write them, and what headings say."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable
from pathlib import Path

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.common.typed_numbers import parse_number
from labapp.files.reading import read_text
from labapp.files.text_encoding import UNTOLD

Line = tuple[int, list[str]]
"""The number of a line in its file, from 1, and its cells."""

_COMMENT = re.compile(r"^\s*(%|!|//).*|#.*")


def table_lines(path: Path) -> list[Line]:
    """Return the numbered lines of a text table, split into cells.

    The separator is a semicolon if there is any in the file, else a tab, else a comma, else blanks;
    beside all but the comma, numbers may have a decimal comma. Text after # is a comment, as is a
    line that begins with %, ! or //, and empty lines are left out. Raises UserError if the file
    isn't text, or holds letters in an encoding that can't be told.
    """
    text = read_text(path, "a table as CSV", any_encoding=True)
    plain = ((k, _COMMENT.sub("", line)) for k, line in enumerate(text.splitlines(), 1))
    kept = [(k, line) for k, line in plain if line.strip()]
    for number, line in kept:
        if UNTOLD in line:
            raise UserError(
                f"{path}, line {number}: {quote(line.strip())} has letters in an encoding that "
                "can't be told. Save the file as UTF-8."
            )
    lines = _split(path, kept)
    _require_one_decimal_sign(path, lines)
    return lines


def parse_numbers(cells: Iterable[str]) -> list[float] | None:
    """Parse the numbers in cells; None if a cell holds no finite number."""
    try:
        return [parse_number(cell) for cell in cells]
    except ValueError:
        return None


def _split(path: Path, kept: list[tuple[int, str]]) -> list[Line]:
    """Return the cells of all lines, by the separator that the table has."""
    for separator in ";\t":
        if any(separator in line.strip() for _, line in kept):
            lines = [(k, _cells(path, k, line, separator)) for k, line in kept]
            # Several tabs in a row only align columns, as blanks do.
            if separator == ";" or all(all(cells) for _, cells in lines):
                return lines
    if any("," in line for _, line in kept) and not _has_decimal_commas(kept):
        return [(k, _cells(path, k, line, ",")) for k, line in kept]
    return [(k, line.split()) for k, line in kept]


def _has_decimal_commas(kept: list[tuple[int, str]]) -> bool:
    """Return whether blanks separate the numbers, in which commas are decimal signs."""
    rows = [re.sub(r"\s*,\s+|\s+,", ",", line).split() for _, line in kept]
    numbers = [row for row in rows if parse_numbers(row) is not None]
    return bool(numbers) and all(len(row) > 1 for row in numbers)


def _cells(path: Path, number: int, line: str, separator: str) -> list[str]:
    """Return the cells of a line; a cell in quotes ends on its line."""
    try:
        (row,) = csv.reader([line.strip(" \r\n")], delimiter=separator, skipinitialspace=True)
    except csv.Error as error:
        raise UserError(f"{path}, line {number}: cannot be split into cells: {error}.") from error
    return [cell.strip() for cell in row]


def _require_one_decimal_sign(path: Path, lines: list[Line]) -> None:
    """Raise UserError if some numbers have points and others commas.

    One of both then stands between groups of digits.
    """
    seen = dict[str, tuple[int, str]]()
    for number, cells in lines:
        for cell in cells:
            for sign in ".,":
                if sign in cell and sign not in seen and parse_numbers([cell]) is not None:
                    seen[sign] = number, cell
    if len(seen) == 2:
        (_, point), (number, comma) = seen["."], seen[","]
        raise UserError(
            f"{path}: has {quote(point)} with a point and, in line {number}, {quote(comma)} with a "
            "comma. Save it with one decimal sign and without signs between groups of digits."
        )


_BRACKETS = re.compile(r"[(\[{]([^)\]}]*)[)\]}]")
_AFTER_SLASH = re.compile(r"/\s*(\S+)\s*$")
_LEVEL = re.compile(r"gr[ea]y(level|value)?|level|index|dn|gl")
_VOLTAGE = re.compile(r"volt|spannung|tension|\bm?v\b|\bdac\b|\bdrive\b", re.IGNORECASE)
_NANOMETRES = re.compile(r"([0-9.,]+)\s*nm\b", re.IGNORECASE)
_PHASE_UNITS = {
    r"pi\b(?:\s*\*?\s*rad)?|π(?:\s*\*?\s*rad)?": 1.0,
    r"rad(?:ians?)?\b": 1 / math.pi,
    r"deg(?:rees?)?\b|°": 1 / 180,
    r"waves?\b|λ|lambda\b": 2.0,
}
"""Units of a phase, as they are written, and how many pi each is."""

_PHASE_WORDS = re.compile(
    r"phase|shift|modulation|delay|phi|φ|\bat\b|\bin\b|\bof\b|\bunits?\b|[@()\[\]{}/,:_\s]",
    re.IGNORECASE,
)
_LOGARITHMS = re.compile(r"\b(od|optical density|db|absorbance)\b", re.IGNORECASE)


def is_level(heading: str) -> bool:
    """Return whether a heading names the panel's grey levels."""
    word = re.sub(r"[\s_\-]", "", _BRACKETS.sub("", heading).lower())
    return _LEVEL.fullmatch(word.removesuffix("s")) is not None


def is_voltage(heading: str) -> bool:
    """Return whether a heading names voltages, or what drives the panel."""
    return _VOLTAGE.search(heading.replace("_", " ")) is not None


def read_phase_heading(heading: str) -> tuple[float, float]:
    """Return the wavelength in nm of a column of phases, and their unit in pi.

    A wavelength alone heads phases in units of pi. Raises ValueError with the reason for a heading
    that leaves one of both open.
    """
    found = _NANOMETRES.search(heading)
    rest = heading if found is None else heading.replace(found[0], " ")
    if found is None:
        try:
            return parse_number(heading), 1.0
        except ValueError:
            raise ValueError(f"{quote(heading)} names no wavelength in nm") from None
    units = []
    for written, factor in _PHASE_UNITS.items():
        shorter = re.sub(rf"(?<![a-z])(?:{written})", " ", rest, flags=re.IGNORECASE)
        units += [factor] if shorter != rest else []
        rest = shorter
    left = _PHASE_WORDS.sub("", rest)
    if left or len(units) > 1:
        raise ValueError(f"{quote(heading)} isn't understood")
    if not units and "ph" in heading.lower():
        raise ValueError(f"{quote(heading)} names no unit of the phase: pi, rad, ° or waves")
    return parse_number(found[1]), units[0] if units else 1.0


def unit_in_heading(heading: str) -> str:
    """Return the unit that a heading names in brackets or after / ; "" if none."""
    found = _BRACKETS.search(heading) or _AFTER_SLASH.search(heading)
    return found[1].strip() if found else ""


def share_unit(heading: str) -> float:
    """Return the unit of a column of shares: 0.01 for per cent, else 1.

    Raises ValueError for logarithms.
    """
    if _LOGARITHMS.search(heading.replace("_", " ")):
        raise ValueError(f"{quote(heading)} is a logarithm. Give shares, 0 to 1, or per cent")
    return 0.01 if "%" in heading or "percent" in heading.lower() else 1.0
