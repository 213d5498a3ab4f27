"""The header of an ENVI file: text of keys and values that says how a cube's numbers lie.

Lines are "key = value", or "key = {values}" over several lines; keys are written in any case, and a
line that begins with a semicolon is a comment (NV5 Geospatial, "ENVI Header Files").
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.files.text_table import parse_numbers
from labapp.files.wavelengths import convert_wavelengths

DATA_TYPES: dict[int, np.dtype[Any]] = {
    1: np.dtype("u1"),
    2: np.dtype("i2"),
    3: np.dtype("i4"),
    4: np.dtype("f4"),
    5: np.dtype("f8"),
    12: np.dtype("u2"),
    13: np.dtype("u4"),
    14: np.dtype("i8"),
    15: np.dtype("u8"),
}
"""Types of numbers by ENVI's code; 6 and 9 are complex, and can't be values of a cube."""

INTERLEAVES = {"bsq": "blr", "bil": "lbr", "bip": "lrb"}
"""Order of the axes in a file by its interleave, the slowest first: bands b, lines l, samples r."""


@dataclass(frozen=True)
class EnviHeader:
    """What an ENVI header says of its data.

    Attributes
    ----------
    shape : tuple of int
        Bands, lines (rows) and samples (columns).
    interleave : str
        Order of the numbers: bsq, bil or bip.
    number_type : numpy.dtype
        Type and byte order of a number.
    offset : int
        Bytes of the file before the first number.
    wavelengths : tuple of float
        Metres, in the file's order of bands.
    gains, offsets : tuple of float
        Numbers that each band is multiplied by, and that are added then.
    ignored : float or None
        Number that stands for a missing value.
    pitch : float or None
        Distance in metres between neighbouring pixels.
    unit, light, description : str
        In words; empty where the header doesn't say.
    """

    shape: tuple[int, int, int]
    interleave: str
    number_type: np.dtype[Any]
    offset: int
    wavelengths: tuple[float, ...]
    gains: tuple[float, ...]
    offsets: tuple[float, ...]
    ignored: float | None
    pitch: float | None
    unit: str
    light: str
    description: str


def parse_header(text: str) -> EnviHeader:
    """Parse the text of an ENVI header; raise UserError that names key, value and remedy."""
    keys = _read_keys(text)
    bands, rows, columns = (_count(keys, key) for key in ("bands", "lines", "samples"))
    interleave = _require(keys, "interleave").lower()
    if interleave not in INTERLEAVES:
        raise UserError(f"interleave is {quote(interleave)}. Write bsq, bil or bip")
    if _whole(keys, "file compression", 0):
        raise UserError("file compression is 1. Write the file without compression")
    scale = _number(keys, "reflectance scale factor")
    # A factor of 0, which some programs write, states nothing.
    divisor = scale if scale else 1.0
    # The wavelengths show that the number of bands isn't made up.
    wavelengths = _wavelengths(keys, bands)
    gains = _band_numbers(keys, "data gain values", bands, 1.0)
    return EnviHeader(
        (bands, rows, columns),
        interleave,
        _number_type(keys),
        _whole(keys, "header offset", 0),
        wavelengths,
        tuple(gain / divisor for gain in gains),
        tuple(one / divisor for one in _band_numbers(keys, "data offset values", bands, 0.0)),
        _number(keys, "data ignore value"),
        _pixel_pitch(keys),
        keys.get("data units", "share of white" if scale else ""),
        keys.get("light", ""),
        keys.get("description", ""),
    )


def format_header(keys: Mapping[str, str]) -> str:
    """Return the text of an ENVI header. The values of lists and texts are in braces already."""
    return "ENVI\n" + "".join(f"{key} = {value}\n" for key, value in keys.items())


def _read_keys(text: str) -> dict[str, str]:
    """Return the values of an ENVI header by key, in lower case, without braces."""
    lines = text.lstrip("\ufeff").splitlines()
    if not lines or lines[0].strip() != "ENVI":
        raise UserError("is not an ENVI header: its first line must be ENVI")
    body = iter([line for line in lines[1:] if not line.lstrip().startswith(";")])
    found = {}
    for line in body:
        name, equals, value = line.partition("=")
        if not equals:
            continue
        key = " ".join(name.lower().split())
        found[key] = _read_value(key, value.strip(), body)
    return found


def _read_value(key: str, value: str, following: Iterator[str]) -> str:
    """Return a value of an ENVI header without its braces, which may close on a following line."""
    if not value.startswith("{"):
        return value
    parts = [value]
    while "}" not in parts[-1]:
        line = next(following, None)
        if line is None:
            raise UserError(f"{quote(key)} has a brace that isn't closed. Add }}")
        parts.append(line)
    return "\n".join(parts).strip("{ \t").partition("}")[0].strip()


def _require(keys: Mapping[str, str], key: str) -> str:
    if key not in keys:
        raise UserError(f"the header has no {key!r}. Add it")
    return keys[key]


def _whole(keys: Mapping[str, str], key: str, default: int) -> int:
    """Return a whole number, 0 or more, from the keys of an ENVI header."""
    value = keys.get(key, str(default))
    if not re.fullmatch(r"[0-9]{1,18}", value):
        raise UserError(f"{key} is {quote(value)}. Write a whole number, 0 or more")
    return int(value)


def _count(keys: Mapping[str, str], key: str) -> int:
    """Return a count, 1 or more, that an ENVI header must have."""
    _require(keys, key)
    count = _whole(keys, key, 0)
    if count < 1:
        raise UserError(f"{key} is {count}. Write 1 or more")
    return count


def _number(keys: Mapping[str, str], key: str) -> float | None:
    """Return a number of an ENVI header; None if it has none."""
    if key not in keys:
        return None
    return _first_number(keys[key], key)


def _first_number(text: str, key: str) -> float:
    """Return the first number of a list in an ENVI header."""
    numbers = _numbers(text, key)
    if not numbers:
        raise UserError(f"{key} is empty. Write a number")
    return numbers[0]


def _numbers(text: str, key: str) -> tuple[float, ...]:
    """Return the numbers of a list in an ENVI header."""
    numbers = parse_numbers(text.replace(",", " ").split())
    if numbers is None:
        raise UserError(f"{key} is {quote(text)}. Write finite numbers with commas between")
    return tuple(numbers)


def _band_numbers(
    keys: Mapping[str, str], key: str, bands: int, default: float
) -> tuple[float, ...]:
    """Return a number for each band from an ENVI header, or the default for all."""
    if key not in keys:
        return (default,) * bands
    found = _numbers(keys[key], key)
    if len(found) != bands:
        raise UserError(f"{key} has {len(found)} numbers. Write {bands}, one for each band")
    return found


def _number_type(keys: Mapping[str, str]) -> np.dtype[Any]:
    """Return the type and byte order of the numbers behind an ENVI header."""
    code = _whole(keys, "data type", 0)
    if code not in DATA_TYPES:
        raise UserError(
            f"data type is {quote(keys.get('data type', 'missing'))}. Write one of "
            f"{', '.join(map(str, DATA_TYPES))}; complex numbers, 6 and 9, are no light"
        )
    order = _whole(keys, "byte order", 0)
    if order not in (0, 1):
        raise UserError(f"byte order is {order}. Write 0 (least significant first) or 1")
    return DATA_TYPES[code].newbyteorder("big" if order else "little")


def _wavelengths(keys: Mapping[str, str], bands: int) -> tuple[float, ...]:
    """Return the wavelengths of an ENVI header in metres."""
    if "wavelength" not in keys:
        raise UserError(
            "the header has no 'wavelength'. Add wavelength = {450, 500, …} and wavelength units "
            "= Nanometers"
        )
    listed = _band_numbers(keys, "wavelength", bands, 0.0)
    return convert_wavelengths(listed, keys.get("wavelength units", ""))


def _pixel_pitch(keys: Mapping[str, str]) -> float | None:
    """Return the pitch of the pixels in metres from an ENVI header; None if it isn't in metres."""
    value = keys.get("pixel size", "")
    if "meter" not in value.lower():
        return None
    first = value.split(",")[0].strip()
    # Pixels of a metre and more are those of a landscape, and not of a sensor.
    return found if 0 < (found := _first_number(first, "pixel size")) < 1e-3 else None
