"""The header of an ENVI file: text of keys and values that says how a cube's numbers lie.

Lines are "key = value", or "key = {values}" over several lines; keys are written in any case, and a
line that begins with a semicolon is a comment (NV5 Geospatial, "ENVI Header Files").
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.common.typed_numbers import parse_decimal
from labapp.files.text_table import parse_numbers
from labapp.files.wavelengths import convert_wavelengths, remark_on_unit

Keys = Mapping[str, str]
"""Values of a header by key, in lower case, without braces."""

_DECIDING = (
    "samples", "lines", "bands", "header offset", "data type", "interleave", "byte order",
    "wavelength", "wavelength units", "bbl", "data ignore value", "reflectance scale factor",
    "data gain values", "data offset values",
)  # fmt: skip
"""Keys that decide how numbers are read, and so must not stand there with two values."""


def read_keys(text: str) -> Keys:
    """Return a header's values by key; raise UserError if it is none of ENVI's."""
    # A brace may open on the line after its key.
    lines = re.sub(r"=[ \t]*\r?\n[ \t]*\{", "= {", text.lstrip("\ufeff")).splitlines()
    first = lines[0].strip() if lines else ""
    if first.startswith("#?"):
        raise UserError("is a picture in Radiance's format, and not an ENVI header")
    if first != "ENVI":
        raise UserError("is not an ENVI header: its first line must be ENVI")
    body = iter([line for line in lines[1:] if not line.lstrip().startswith(";")])
    found = dict[str, str]()
    for line in body:
        name, equals, value = line.partition("=")
        if not equals:
            continue
        key = " ".join(name.lower().split())
        read = _read_value(key, value.strip(), body)
        if found.get(key, read) != read and key in _DECIDING:
            raise UserError(
                f"{key} stands there twice, as {quote(found[key])} and {quote(read)}. Leave one"
            )
        found[key] = read
    return found


def _read_value(key: str, value: str, following: Iterator[str]) -> str:
    """Return a value without its braces, which may close on a following line."""
    if not value.startswith("{"):
        return value
    parts = [value]
    while "}" not in parts[-1]:
        line = next(following, None)
        if line is None:
            raise UserError(f"{quote(key)} has a brace that isn't closed. Add }}")
        parts.append(line)
    return "\n".join(parts).strip("{ \t").partition("}")[0].strip()


def require_key(keys: Keys, key: str) -> str:
    """Return the value of a key that must be there."""
    if key not in keys:
        raise UserError(f"the header has no {key!r}. Add it")
    return keys[key]


def read_whole(keys: Keys, key: str, default: int) -> int:
    """Return a whole number, 0 or more."""
    value = keys.get(key, str(default))
    if not re.fullmatch(r"[0-9]{1,18}", value):
        raise UserError(f"{key} is {quote(value)}. Write a whole number, 0 or more")
    return int(value)


def read_count(keys: Keys, key: str) -> int:
    """Return a count, 1 or more, that must be there."""
    require_key(keys, key)
    count = read_whole(keys, key, 0)
    if count < 1:
        raise UserError(f"{key} is {count}. Write 1 or more")
    return count


def read_number(keys: Keys, key: str) -> float | None:
    """Return the one number of a key; None without the key."""
    if key in keys and len(read_list(keys[key], key)) > 1:
        raise UserError(f"{key} is {quote(keys[key])}. Write one number, with a decimal point")
    return None if key not in keys else first_number(keys[key], key)


def first_number(text: str, key: str) -> float:
    """Return the first number of a list."""
    numbers = read_list(text, key)
    if not numbers:
        raise UserError(f"{key} is empty. Write a number")
    return numbers[0]


def read_list(text: str, key: str) -> tuple[float, ...]:
    """Parse the numbers of a list, with commas or spaces between."""
    numbers = parse_numbers(text.replace(",", " ").split())
    if numbers is None:
        raise UserError(f"{key} is {quote(text)}. Write finite numbers with commas between")
    return tuple(numbers)


def read_band_list(keys: Keys, key: str, bands: int, default: float) -> tuple[float, ...]:
    """Return a number for each band, or the default for all."""
    if key not in keys:
        return (default,) * bands
    found = read_list(keys[key], key)
    if len(found) != bands:
        raise UserError(f"{key} has {len(found)} numbers. Write {bands}, one for each band")
    return found


_NOT_FINITE = ("nan", "inf", "infinity")

DATA_TYPES = {
    1: "u1", 2: "i2", 3: "i4", 4: "f4", 5: "f8", 12: "u2", 13: "u4", 14: "i8", 15: "u8",
}  # fmt: skip
"""Types of numbers by ENVI's code; 6 and 9 are complex, and can't be values of a cube."""

INTERLEAVES = {"bsq": "blr", "bil": "lbr", "bip": "lrb"}
"""Order of the axes in a file by its interleave, the slowest first: bands b, lines l, samples r."""

_FILE_TYPES = ("", "envi", "envi standard")
"""Values of the key "file type" for bare numbers of light; older headers lack it."""

_NO_CUBES = {
    "envi classification": "numbers of classes, and no light",
    "envi spectral library": "spectra without a picture",
}
"""What other files of ENVI's own hold."""

_LISTED = 12
"""Bad bands that a remark lists. Chosen: a line."""


@dataclass(frozen=True)
class EnviHeader:
    """What an ENVI header says of its data, and remarks (notes) on what was taken for what.

    shape: bands, lines (rows) and samples (columns) of the file.
    offset: bytes of the file before the first number.
    order: places in the file of the cube's bands, by rising wavelength; bad bands are left out.
    wavelengths: metres, in that order.
    gains, offsets: numbers that each of the file's bands is multiplied by, and that are added then.
    ignored: number that stands for a missing value.
    pitch: distance between neighbouring pixels, metres.
    """

    shape: tuple[int, int, int]
    interleave: str
    number_type: np.dtype[Any]
    offset: int
    order: tuple[int, ...]
    wavelengths: tuple[float, ...]
    gains: tuple[float, ...]
    offsets: tuple[float, ...]
    ignored: float | None
    pitch: float | None
    unit: str
    light: str
    description: str
    notes: tuple[str, ...]

    @property
    def size(self) -> int:
        """Bytes that the file of the numbers has."""
        return self.offset + math.prod(self.shape) * self.number_type.itemsize


def parse_header(text: str) -> EnviHeader:
    """Parse the text of a header; raise UserError that names key, value and remedy."""
    keys = read_keys(text)
    _require_bare_numbers(keys)
    bands, rows, columns = (read_count(keys, key) for key in ("bands", "lines", "samples"))
    interleave = require_key(keys, "interleave").lower()
    if interleave not in INTERLEAVES:
        raise UserError(f"interleave is {quote(interleave)}. Write bsq, bil or bip")
    # The wavelengths show that the number of bands isn't made up.
    if "wavelength" not in keys:
        raise UserError(
            "the header has no 'wavelength'. Add wavelength = {450, 500, …} and wavelength units "
            "= Nanometers"
        )
    listed = read_band_list(keys, "wavelength", bands, 0.0)
    good = _good_bands(keys, bands)
    unit = keys.get("wavelength units", "")
    wavelengths = convert_wavelengths([listed[band] for band in good], unit)
    rising = sorted(range(len(good)), key=wavelengths.__getitem__)
    number_type, ignored = _number_type(keys), _ignored_number(keys)
    # The number that stands for a reflectance of 1; 0, which some programs write, states nothing.
    divisor = read_number(keys, "reflectance scale factor")
    if divisor is not None and divisor < 0:
        raise UserError(f"reflectance scale factor is {divisor:g}. Write a number above 0")
    gains = read_band_list(keys, "data gain values", bands, 1.0)
    offsets = read_band_list(keys, "data offset values", bands, 0.0)
    remarks = [
        _remark_on_bad_bands(listed, good, unit),
        remark_on_unit([listed[band] for band in good], unit),
    ]
    if "byte order" not in keys and number_type.itemsize > 1:
        told = "the byte order isn't stated: the least significant byte is taken to be the first"
        remarks.append(told)
    if ignored is not None:
        remarks.append(f"{ignored:g} stands for a missing value (data ignore value)")
    scales = ("data gain values", "data offset values", "reflectance scale factor")
    if used := [key for key in scales if key in keys]:
        remarks.append(f"its numbers are scaled by {', '.join(used)}")
    return EnviHeader(
        (bands, rows, columns),
        interleave,
        number_type,
        read_whole(keys, "header offset", 0),
        tuple(good[at] for at in rising),
        tuple(wavelengths[at] for at in rising),
        tuple(gain / (divisor or 1.0) for gain in gains),
        tuple(one / (divisor or 1.0) for one in offsets),
        ignored,
        _pixel_pitch(keys),
        keys.get("data units", "share of white" if divisor else ""),
        keys.get("light", ""),
        keys.get("description", ""),
        tuple(filter(None, remarks)),
    )


def _require_bare_numbers(keys: Keys) -> None:
    """Raise UserError if the file beside the header isn't the bare numbers of pictures."""
    kind = " ".join(keys.get("file type", "").replace("_", " ").split())
    if kind.lower() not in _FILE_TYPES:
        what = _NO_CUBES.get(kind.lower(), "another format than bare numbers")
        raise UserError(f"file type is {quote(kind)}: {what}. Save the picture as ENVI Standard")
    if read_whole(keys, "file compression", 0):
        raise UserError("file compression is 1. Write the file without compression")
    for key in ("major frame offsets", "minor frame offsets"):
        if any(read_list(keys.get(key, ""), key)):
            raise UserError(f"{key} are {quote(keys[key])}. Write the file without such gaps")


def _good_bands(keys: Keys, bands: int) -> list[int]:
    """Return which bands are good by the list of bad bands, bbl."""
    listed = read_band_list(keys, "bbl", bands, 1.0)
    wrong = [one for one in listed if one not in (0.0, 1.0)]
    if wrong:
        raise UserError(f"bbl has {wrong[0]:g}. Write 1 for a good band and 0 for a bad one")
    good = [band for band, one in enumerate(listed) if one]
    if not good:
        raise UserError("bbl marks all bands as bad. Write 1 for those that are good")
    return good


def _ignored_number(keys: Keys) -> float | None:
    """Return the number that stands for a missing value; it may be NaN."""
    text = keys.get("data ignore value", "")
    parts = set(text.replace(",", " ").split())
    if not parts:
        return None
    try:
        (one,) = parts
        # It is compared, not computed with: often it is the largest number of the type.
        return float(one if one.lstrip("+-").lower() in _NOT_FINITE else parse_decimal(one))
    except ValueError as error:
        raise UserError(f"data ignore value is {quote(text)}. Write a number") from error


def _number_type(keys: Keys) -> np.dtype[Any]:
    """Return the type and byte order of the numbers."""
    code = read_whole(keys, "data type", 0)
    if code not in DATA_TYPES:
        raise UserError(
            f"data type is {quote(keys.get('data type', 'missing'))}. Write one of "
            f"{', '.join(map(str, DATA_TYPES))}; complex numbers, 6 and 9, are no light"
        )
    order = read_whole(keys, "byte order", 0)
    if order not in (0, 1):
        raise UserError(f"byte order is {order}. Write 0 (least significant first) or 1")
    return np.dtype(DATA_TYPES[code]).newbyteorder("big" if order else "little")


def _pixel_pitch(keys: Keys) -> float | None:
    """Return the pitch of the pixels in metres; None if it isn't stated in metres."""
    value = keys.get("pixel size", "")
    if "meter" not in value.lower():
        return None
    first = value.split(",")[0].strip()
    # Pixels of a metre and more are those of a landscape, and not of a sensor.
    return found if 0 < (found := first_number(first, "pixel size")) < 1e-3 else None


def _remark_on_bad_bands(listed: Sequence[float], good: Sequence[int], unit: str) -> str:
    """Say which bands are marked as bad."""
    bad = sorted(set(range(len(listed))) - set(good))
    if not bad:
        return ""
    named = ", ".join(f"{listed[band]:g}" for band in bad[:_LISTED])
    more = ", …" if len(bad) > _LISTED else ""
    return (
        f"{len(bad)} of {len(listed)} bands are marked as bad (bbl) and left out: {named}{more} "
        f"{unit}"
    ).rstrip()
