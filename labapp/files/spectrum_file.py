"""Spectra from text files: wavelengths in nm, and a column for each spectrum."""

from __future__ import annotations

import csv
from functools import lru_cache
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.reading import bundled
from optics.light.spectrum import Spectrum


def read_spectrum(path: Path, column: str | None = None) -> Spectrum:
    """One spectrum of a file; column: its name, which is needed where there are several.

    UserError names file, line and value.
    """
    spectra = read_spectra(path)
    if column is None and len(spectra) == 1:
        return next(iter(spectra.values()))
    if column is None:
        raise UserError(f"{path}: has {len(spectra)} columns; name one: {', '.join(spectra)}.")
    if column not in spectra:
        raise UserError(f"{path}: has no column {column!r}; choose among {', '.join(spectra)}.")
    return spectra[column]


def read_spectra(path: Path) -> dict[str, Spectrum]:
    """All spectra of a CSV file, by the names in its first line.

    Lines from # on are remarks. The first column is wavelengths in nm, rising; the first line
    may be left out, and the columns then are called 1, 2 and so on.
    UserError names file, line and value.
    """
    names: list[str] = []
    rows: list[list[float]] = []
    for number, cells in _lines(path):
        numbers = _numbers(cells)
        if numbers is None and not rows and not names:
            names = cells
            continue
        if numbers is None:
            raise UserError(f"{path}, line {number}: {','.join(cells)!r} isn't numbers.")
        if rows and len(numbers) != len(rows[0]):
            raise UserError(
                f"{path}, line {number}: has {len(numbers)} numbers, the lines above have "
                f"{len(rows[0])}."
            )
        rows.append(numbers)
    if not rows or len(rows[0]) < 2 or (names and len(names) != len(rows[0])):
        raise UserError(
            f"{path}: is no table of spectra. Give lines of a wavelength in nm and a value, "
            "separated by commas."
        )
    titles = names[1:] or [str(k) for k in range(1, len(rows[0]))]
    if len(set(titles)) < len(titles):
        raise UserError(f"{path}: two columns have the same name. Give each its own.")
    wavelengths = tuple(row[0] / 1e9 for row in rows)
    try:
        return {
            title: Spectrum(wavelengths, tuple(row[k + 1] for row in rows))
            for k, title in enumerate(titles)
        }
    except ValueError as error:
        raise UserError(f"{path}: {error}.") from error


@lru_cache(maxsize=16)
def bundled_spectra(name: str) -> dict[str, Spectrum]:
    """Of a table that comes with the application; not to be changed."""
    return read_spectra(bundled("spectra") / f"{name}.csv")


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}. Check the path.") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: is not a text file. Give a CSV file.") from error
    plain = [line.split("#", 1)[0].strip() for line in text.splitlines()]
    kept = [(k, line) for k, line in enumerate(plain, 1) if line]
    separator = ";" if any(";" in line for _, line in kept) else ","
    cells = csv.reader([line for _, line in kept], delimiter=separator)
    return [
        (number, [cell.strip() for cell in row])
        for (number, _), row in zip(kept, cells, strict=True)
    ]


def _numbers(cells: list[str]) -> list[float] | None:
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        return None
