"""Wavelengths that are read or typed: their unit, and whether it can be the right one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from labapp.common.errors import UserError

SHORTEST, LONGEST = 200e-9, 20e-6
"""Range in metres of the wavelengths that cubes may have: from deep ultraviolet to thermal
infrared, as spectral cameras record it."""

_VISIBLE = (380e-9, 1100e-9)
"""Range in metres by which the unit of numbers is guessed: what silicon detects of visible and near
infrared light."""

_REFLECTED = (350e-9, 2600e-9)
"""Range in metres in which a unit that isn't stated is taken for granted, if it is the only one:
the sunlight that spectral cameras record, 400 to 2500 nm, with a margin. Chosen."""

_LIGHT = (100e-9, 100e-6)
"""Range in metres of the light of which people type the wavelength, from ultraviolet to far
infrared. Chosen: a number in metres, micrometres or picometres lies beyond it."""

_LIGHT_SPEED = 299_792_458.0

_PER_METRE = {
    "nanometres": 1e9,
    "micrometres": 1e6,
    "ångström": 1e10,
    "picometres": 1e12,
    "millimetres": 1e3,
    "centimetres": 1e2,
    "metres": 1.0,
}
"""How many of each unit make a metre."""

_WAVELENGTH_TIMES = {
    "wavenumbers (1/cm)": 1e-2,
    "gigahertz": 1e-9 * _LIGHT_SPEED,
    "megahertz": 1e-6 * _LIGHT_SPEED,
}
"""Units of which a greater number is a shorter wavelength: their product with metres."""

_UNITS = (
    "nanometres", "micrometres", "ångström", "metres", "millimetres", "centimetres",
    "wavenumbers (1/cm)", "gigahertz", "megahertz",
)  # fmt: skip
"""Units that wavelengths may be stated in, the usual ones first."""

_LENGTHS = ("nanometres", "micrometres", "ångström", "picometres", "metres")
"""Units that people may mean who type a wavelength; picometres by a slip."""

_SPELLINGS = {
    "nanometres": "nm nanometers nanometer nanometre nanometres",
    "micrometres": "um µm μm micron microns micrometers micrometer micrometre micrometres",
    "ångström": "angstrom angstroms ångström ångstrom å",
    "millimetres": "mm millimeters millimeter millimetre millimetres",
    "centimetres": "cm centimeters centimeter centimetre centimetres",
    "metres": "m meter meters metre metres",
    "wavenumbers (1/cm)": "wavenumber wavenumbers cm-1 1/cm cm^-1",
    "gigahertz": "ghz gigahertz",
    "megahertz": "mhz megahertz",
}
"""Spellings of each unit, in lower case; ENVI has a name for all but a few."""

NANOMETRES = frozenset(_SPELLINGS["nanometres"].split())
"""Spellings of nanometres, in lower case."""

_NAMES = {word: name for name, words in _SPELLINGS.items() for word in words.split()}

_UNSTATED = ("", "unknown")
"""What files write that don't state a unit."""


def convert_wavelengths(values: Sequence[float], unit: str) -> tuple[float, ...]:
    """Convert wavelengths, wavenumbers or frequencies to metres, in their order.

    unit: in any usual spelling. If it is empty or "unknown", it is found from the numbers, if only
    one is plausible.
    Raises UserError for a unit that isn't known, numbers that can't be wavelengths in it, or
    numbers without a unit that several could be meant in.
    """
    written = unit.strip().lower()
    if written in _UNSTATED:
        return _in_metres(values, _only_plausible_unit(values))
    if written not in _NAMES:
        raise UserError(
            f"wavelength units {unit!r} aren't known. Write Nanometers, Micrometers or Meters"
        )
    found = _in_metres(values, _NAMES[written])
    if all(SHORTEST <= one <= LONGEST for one in found):
        return found
    raise UserError(f"wavelengths {_span(values)} can't be {_NAMES[written]}.{_suggest(values)}")


def remark_on_unit(values: Sequence[float], unit: str) -> str:
    """Say in which unit wavelengths were taken, if none is stated; else nothing."""
    if unit.strip().lower() not in _UNSTATED:
        return ""
    name = _only_plausible_unit(values)
    return f"the unit of its wavelengths isn't stated: {_span(values)} are taken to be {name}"


def require_metres(values: Sequence[float]) -> None:
    """Raise UserError unless numbers can be wavelengths in metres, rising."""
    if not values or not all(SHORTEST <= one <= LONGEST for one in values):
        raise UserError(f"wavelengths {_span(values)} can't be metres.{_suggest(values)}")
    if any(a >= b for a, b in pairwise(values)):
        raise UserError("wavelengths don't rise. Sort the bands, the shortest wavelength first")


def require_nanometres(name: str, nanometres: float) -> None:
    """Raise UserError for a number that can't be a wavelength in nanometres.

    name: option, key or place of the number, for the message.
    """
    doubt = doubt_nanometres(nanometres)
    if doubt:
        raise UserError(f"{name} {doubt}.")


def doubt_nanometres(nanometres: float) -> str:
    """Say why a number can't be a wavelength in nanometres, and what it may be; "" if it can."""
    if _LIGHT[0] <= nanometres / 1e9 <= _LIGHT[1]:
        return ""
    units = _units_within([nanometres], *_VISIBLE, _LENGTHS) or _units_within(
        [nanometres], *_LIGHT, _LENGTHS
    )
    if not units:
        return f"is {nanometres:g}: give a wavelength in nanometres, such as 550"
    meant = 1e9 * _in_metres([nanometres], units[0])[0]
    return (
        f"is {nanometres:g} nm, which is no light: did you mean {meant:.6g} nm, "
        f"{nanometres:g} in {units[0]}? Give nanometres"
    )


def guess_unit(values: Sequence[float]) -> str:
    """Guess the unit of wavelengths, in words; "" if none makes them visible."""
    return next(iter(_units_within(values, *_VISIBLE, _LENGTHS)), "")


def format_nanometres(wavelength: float) -> str:
    """Format a wavelength in metres as nanometres with their unit, such as "450 nm"."""
    return f"{wavelength * 1e9:.6g} nm"


def list_nanometres(wavelengths: Sequence[float]) -> str:
    """List wavelengths in metres as nanometres, such as "450, 500 nm"."""
    return f"{', '.join(f'{one * 1e9:.6g}' for one in wavelengths)} nm"


def _in_metres(values: Sequence[float], name: str) -> tuple[float, ...]:
    """Return numbers in metres, by the name of their unit; NaN for 0 and less."""
    convert: Callable[[float], float]
    if name in _PER_METRE:
        convert = _PER_METRE[name].__rtruediv__
    else:
        convert = _WAVELENGTH_TIMES[name].__truediv__
    return tuple(convert(float(one)) if one > 0 else math.nan for one in values)


def _units_within(
    values: Sequence[float], shortest: float, longest: float, units: Sequence[str] = _UNITS
) -> list[str]:
    """Return the units in which all numbers are wavelengths in a range in metres."""
    fitting = (
        name
        for name in units
        if all(shortest <= one <= longest for one in _in_metres(values, name))
    )
    return list(fitting) if values else []


def _only_plausible_unit(values: Sequence[float]) -> str:
    """Return the one unit that numbers can be meant in; raise UserError if it isn't one.

    One unit must make them reflected sunlight, or nanometres be the only unit of any light, which
    most programs mean that leave the unit out.
    """
    plausible, possible = (
        _units_within(values, *span) for span in (_REFLECTED, (SHORTEST, LONGEST))
    )
    found = plausible or possible
    if len(plausible) == 1 or possible == ["nanometres"]:
        return found[0]
    numbers = f"wavelengths {_span(values)}"
    if "nanometres" not in found:
        numbers += " can't be nanometres"
    asked = f": in {' or '.join(found)}? Say so with units" if found else ". Add it"
    raise UserError(f"{numbers}, and their unit isn't stated{asked}")


def _suggest(values: Sequence[float]) -> str:
    """Say which unit wavelengths seem to be in; nothing if none fits."""
    guess = guess_unit(values)
    return f" In {guess}? Say so with units" if guess else ""


def _span(values: Sequence[float]) -> str:
    """Return a range in words."""
    if not values:
        return "(none)"
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
