"""Wavelengths in files and on the command line: their unit, and whether it can be the right one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from labapp.common.errors import UserError

SHORTEST, LONGEST = 200e-9, 20e-6
"""Range in metres of the wavelengths that cubes may have: from deep ultraviolet to thermal
infrared, as spectral cameras record it."""

_VISIBLE = (380e-9, 1100e-9)
"""Range in metres by which the unit of numbers is guessed: what silicon detects of visible and near
infrared light."""

_PER_METRE = {
    "nanometres": 1e9,
    "micrometres": 1e6,
    "ångström": 1e10,
    "picometres": 1e12,
    "metres": 1.0,
}
"""How many of each unit make a metre; the units that are suggested for numbers in a wrong one."""

_NAMES = {
    "nm": "nanometres",
    "nanometers": "nanometres",
    "nanometer": "nanometres",
    "nanometre": "nanometres",
    "nanometres": "nanometres",
    "um": "micrometres",
    "µm": "micrometres",
    "μm": "micrometres",
    "micron": "micrometres",
    "microns": "micrometres",
    "micrometers": "micrometres",
    "micrometer": "micrometres",
    "micrometre": "micrometres",
    "micrometres": "micrometres",
    "angstrom": "ångström",
    "angstroms": "ångström",
    "m": "metres",
    "meter": "metres",
    "meters": "metres",
    "metre": "metres",
    "metres": "metres",
}


def convert_wavelengths(values: Sequence[float], unit: str) -> tuple[float, ...]:
    """Convert the wavelengths of a file to metres.

    Parameters
    ----------
    values : sequence of float
        Numbers as the file states them.
    unit : str
        Their unit, in any usual spelling. If it is empty or "unknown", nanometres are assumed, as
        most programs that leave it out mean them.

    Returns
    -------
    tuple of float
        The wavelengths in metres, in the order of `values`.

    Raises
    ------
    UserError
        For a unit that isn't one of length, or numbers that can't be wavelengths in it.
    """
    written = unit.strip().lower()
    stated = written not in ("", "unknown")
    if stated and written not in _NAMES:
        raise UserError(
            f"wavelength units {unit!r} aren't known. Write Nanometers, Micrometers or Meters"
        )
    name = _NAMES[written] if stated else "nanometres"
    found = tuple(float(value) / _PER_METRE[name] for value in values)
    if all(SHORTEST <= one <= LONGEST for one in found):
        return found
    numbers = f"wavelengths {_span(values)}"
    if not stated:
        guess = guess_unit(values)
        raise UserError(
            f"{numbers}: in {guess}? Say so with units"
            if guess
            else f"{numbers} can't be nanometres"
        )
    raise UserError(f"{numbers} can't be {name}.{_suggest(values)}")


def require_metres(values: Sequence[float]) -> None:
    """Raise UserError unless a cube's numbers can be wavelengths in metres, rising."""
    if not values or not all(SHORTEST <= one <= LONGEST for one in values):
        raise UserError(f"wavelengths {_span(values)} can't be metres.{_suggest(values)}")
    if any(a >= b for a, b in pairwise(values)):
        raise UserError("wavelengths don't rise. Sort the bands, the shortest wavelength first")


def guess_unit(values: Sequence[float]) -> str:
    """Guess the unit of a file's wavelengths, in words; "" if none makes them visible."""
    for name, size in _PER_METRE.items():
        if values and all(_VISIBLE[0] <= one / size <= _VISIBLE[1] for one in values):
            return name
    return ""


def format_nanometres(wavelength: float) -> str:
    """Return a band's wavelength in nanometres with its unit, such as "450 nm"."""
    return f"{wavelength * 1e9:.6g} nm"


def list_nanometres(wavelengths: Sequence[float]) -> str:
    """Return the wavelengths of a cube's bands in nanometres, such as "450, 500 nm"."""
    return f"{', '.join(f'{one * 1e9:.6g}' for one in wavelengths)} nm"


def _suggest(values: Sequence[float]) -> str:
    """Say which unit a file's wavelengths seem to be in; nothing if none fits."""
    guess = guess_unit(values)
    return f" In {guess}? Say so with units" if guess else ""


def _span(values: Sequence[float]) -> str:
    """Return the range of a file's wavelengths in words."""
    if not values:
        return "(none)"
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
