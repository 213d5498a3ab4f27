"""Spectra as CSV: wavelengths in nm, and a column for each spectrum."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.files.reading import bundled_path
from labapp.files.text_table import parse_numbers, share_unit, table_lines, unit_in_heading
from labapp.files.wavelengths import NANOMETRES, convert_wavelengths, require_nanometres
from optics.light.spectrum import Spectrum


def read_spectrum(path: Path, column: str | None = None) -> Spectrum:
    """Read one spectrum of a CSV table; `column` must be given if there are several.

    Raises UserError with file, line and value.
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
    """Read all spectra of a CSV table, by the names in its first line.

    Text after # is a comment. The first column holds wavelengths, rising: in nm, or in
    the unit that its name ends with, as "wavelength (µm)". A column whose name has a % holds per
    cent, and is read as shares. The line of names may be left out; the columns are then called 1, 2
    and so on.

    Raises UserError with file, line and value.
    """
    names: list[str] = []
    rows: list[list[float]] = []
    for number, cells in table_lines(path):
        values = parse_numbers(cells)
        if values is None and not rows and not names:
            names = cells
            continue
        if values is None:
            hint = "" if rows else " Put # before lines of text above the names of columns."
            raise UserError(
                f"{path}, line {number}: {quote(','.join(cells))} isn't finite numbers.{hint}"
            )
        if rows and len(values) != len(rows[0]):
            raise UserError(
                f"{path}, line {number}: has {len(values)} numbers, the lines above have "
                f"{len(rows[0])}."
            )
        rows.append(values)
    if not rows or len(rows[0]) < 2 or (names and len(names) != len(rows[0])):
        raise UserError(
            f"{path}: is no table of spectra. Give lines of a wavelength in nm and a value, "
            "separated by commas."
        )
    titles = names[1:] or [str(k) for k in range(1, len(rows[0]))]
    if len(set(titles)) < len(titles):
        raise UserError(f"{path}: two columns have the same name. Give each its own.")
    wavelengths = _in_metres(path, [row[0] for row in rows], names[0] if names else "")
    order = range(len(rows))
    if names and _unit(names[0]) and wavelengths[0] > wavelengths[-1]:
        # Wavenumbers rise where wavelengths fall.
        order = order[::-1]
    try:
        units = [share_unit(title) for title in titles]
        return {
            title: Spectrum(
                tuple(wavelengths[n] for n in order), tuple(unit * rows[n][k] for n in order)
            )
            for k, (title, unit) in enumerate(zip(titles, units, strict=True), 1)
        }
    except ValueError as error:
        raise UserError(f"{path}: {error}.") from error


def _unit(heading: str) -> str:
    """Return the unit that the first column names; "" if it is nm, or none."""
    unit = unit_in_heading(heading)
    return "" if unit.lower() in NANOMETRES else unit


def _in_metres(path: Path, numbers: list[float], heading: str) -> tuple[float, ...]:
    """Return wavelengths in metres, by the unit that their heading names."""
    if unit := _unit(heading):
        try:
            return convert_wavelengths(numbers, unit)
        except UserError as error:
            raise UserError(f"{path}: {error}.") from error
    for nanometres in (numbers[0], numbers[-1]):
        require_nanometres(f"{path}: a wavelength", nanometres)
    return tuple(one / 1e9 for one in numbers)


@lru_cache(maxsize=16)
def bundled_spectra(name: str) -> dict[str, Spectrum]:
    """Read spectra that come with the application; the result must not be changed."""
    return read_spectra(bundled_path("spectra") / f"{name}.csv")
