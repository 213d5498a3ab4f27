"""The header of an ENVI file: text of keys and values that says how a cube's numbers lie.

The keys are those of NV5 Geospatial, "ENVI Header Files".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.common.typed_numbers import parse_decimal
from labapp.files.cubes.envi_keys import (
    Keys,
    first_number,
    read_band_list,
    read_count,
    read_keys,
    read_list,
    read_number,
    read_whole,
    require_key,
)
from labapp.files.wavelengths import convert_wavelengths, remark_on_unit

_NOT_FINITE = ("nan", "inf", "infinity")

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
    """What an ENVI header says of its data.

    shape: bands, lines (rows) and samples (columns) of the file.
    interleave: order of the numbers, bsq, bil or bip.
    number_type: type and byte order of a number.
    offset: bytes of the file before the first number.
    order: places in the file of the cube's bands, by rising wavelength; bad bands are left out.
    wavelengths: metres, in that order.
    gains, offsets: numbers that each of the file's bands is multiplied by, and that are added then.
    ignored: number that stands for a missing value.
    pitch: distance between neighbouring pixels, metres.
    unit, light, description: in words; empty where the header doesn't say.
    notes: remarks for the user on what was taken for what.
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
    listed = _list_wavelengths(keys, bands)
    good = _good_bands(keys, bands)
    unit = keys.get("wavelength units", "")
    wavelengths = convert_wavelengths([listed[band] for band in good], unit)
    rising = sorted(range(len(good)), key=wavelengths.__getitem__)
    number_type, ignored = _number_type(keys), _ignored_number(keys)
    divisor = _scale_factor(keys)
    gains = read_band_list(keys, "data gain values", bands, 1.0)
    offsets = read_band_list(keys, "data offset values", bands, 0.0)
    remarks = (
        _remark_on_bad_bands(listed, good, unit),
        remark_on_unit([listed[band] for band in good], unit),
        _remark_on_order(keys, number_type),
        _remark_on_ignored(ignored),
        _remark_on_scale(keys),
    )
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


def format_header(keys: Mapping[str, str]) -> str:
    """Return a header's text. The values of lists and texts are in braces already."""
    return "ENVI\n" + "".join(f"{key} = {value}\n" for key, value in keys.items())


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


def _list_wavelengths(keys: Keys, bands: int) -> tuple[float, ...]:
    """Return the wavelengths as they are listed, in the header's own unit."""
    if "wavelength" not in keys:
        raise UserError(
            "the header has no 'wavelength'. Add wavelength = {450, 500, …} and wavelength units "
            "= Nanometers"
        )
    return read_band_list(keys, "wavelength", bands, 0.0)


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


def _scale_factor(keys: Keys) -> float | None:
    """Return the number that stands for a reflectance of 1; None if none does."""
    factor = read_number(keys, "reflectance scale factor")
    if factor is not None and factor < 0:
        raise UserError(f"reflectance scale factor is {factor:g}. Write a number above 0")
    # A factor of 0, which some programs write, states nothing.
    return factor or None


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
    return DATA_TYPES[code].newbyteorder("big" if order else "little")


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


def _remark_on_order(keys: Keys, number_type: np.dtype[Any]) -> str:
    """Say that the order of bytes isn't stated."""
    if "byte order" in keys or number_type.itemsize == 1:
        return ""
    return "the byte order isn't stated: the least significant byte is taken to be the first"


def _remark_on_ignored(ignored: float | None) -> str:
    """Say which number stands for missing values."""
    if ignored is None:
        return ""
    return f"{ignored:g} stands for a missing value (data ignore value)"


def _remark_on_scale(keys: Keys) -> str:
    """Say by which keys the numbers are scaled."""
    scales = ("data gain values", "data offset values", "reflectance scale factor")
    used = [key for key in scales if key in keys]
    return f"its numbers are scaled by {', '.join(used)}" if used else ""
