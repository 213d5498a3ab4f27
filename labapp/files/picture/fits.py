"""The pictures in FITS files (FITS Standard 4.0, Pence et al., A&A 524, A42, and its update).

A file is a row of units: each has a header of lines of 80 characters, and data. Pictures stand in
the first unit, or in extensions of the type IMAGE; each plane is a page, and three planes of one
unit are red, green and blue. Rows are kept in the file's order.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.plain_text import printable_line, quote
from labapp.files.exif import Exif
from labapp.files.picture.encoding import LINEAR
from labapp.files.picture.stored import StoredPicture

Keys = dict[str, bool | int | float | str]

_BLOCK, _LINE = 2880, 80
"""Bytes of the blocks in which a file is written, and of a header's line (section 3.1)."""

_MOST_UNITS = 10_000
_MOST_AXES = 999
_MOST_LINES = 100_000
"""Units of a file, axes of a unit (section 4.4.1.1) and lines of a header that are looked at."""

TYPES = {8: ">u1", 16: ">i2", 32: ">i4", 64: ">i8", -32: ">f4", -64: ">f8"}
"""Types of numbers by BITPIX (table 8)."""

_VALUE = re.compile(r"\s*(?:'((?:[^']|'')*)'|([^/\s]+))")
"""A line's value: a text in quotes, or a word up to the comment."""


@dataclass(frozen=True)
class FitsUnit:
    """A header's keywords, and where the data after it are: place and bytes."""

    keys: Keys
    start: int
    size: int

    @property
    def shape(self) -> tuple[int, ...]:
        """The numbers along the axes, the slowest first."""
        return tuple(keyword_integer(self.keys, f"NAXIS{k}") for k in range(self.axes, 0, -1))

    @property
    def axes(self) -> int:
        """How many axes the data have."""
        return keyword_integer(self.keys, "NAXIS")

    @property
    def is_picture(self) -> bool:
        """Whether the data are one or several pictures."""
        is_image = str(self.keys.get("XTENSION", "IMAGE")).strip() == "IMAGE"
        return is_image and self.axes >= 2 and math.prod(self.shape) > 0

    @property
    def is_colour(self) -> bool:
        """Whether three planes are red, green and blue: nothing says that they are others."""
        planes = math.prod(self.shape[:-2])
        meaning = str(self.keys.get("CTYPE3", "")).strip().upper()
        return planes == 3 and meaning in ("", "RGB", "COLOR", "COLOUR")

    @property
    def pages(self) -> int:
        """How many pictures the data are."""
        return 1 if self.is_colour else math.prod(self.shape[:-2])


def read_units(path: Path, data: bytes) -> list[FitsUnit]:
    """Return all units; UserError if one of them is damaged or cut."""
    found: list[FitsUnit] = []
    at = 0
    while at < len(data) and len(found) < _MOST_UNITS:
        # What isn't a unit may follow the last one (section 3.5).
        if found and data[at : at + 8] != b"XTENSION":
            break
        keys, start = _read_header(path, data, at)
        size = _data_size(path, keys)
        if start + size > len(data):
            raise damaged_fits(
                path, f"its data end early, {start + size - len(data)} bytes are missing"
            )
        found.append(FitsUnit(keys, start, size))
        at = start + size + -size % _BLOCK
    return found


def _read_header(path: Path, data: bytes, at: int) -> tuple[Keys, int]:
    """Return the keywords of a header, and the place of the data after it."""
    keys: Keys = {}
    for k in range(_MOST_LINES):
        line = data[at + k * _LINE : at + (k + 1) * _LINE].decode("latin-1")
        if len(line) < _LINE:
            break
        name = line[:8].rstrip()
        if name == "END":
            used = (k + 1) * _LINE
            return keys, at + used + -used % _BLOCK
        if line[8:10] == "= " and name not in keys and (value := _parse(line[10:])) is not None:
            keys[name] = value
    raise damaged_fits(path, "a header has no end")


def _parse(text: str) -> bool | int | float | str | None:
    """Return the value of a header's line (section 4.2); None if it has none that is real."""
    found = _VALUE.match(text)
    if not found:
        return None
    if found[1] is not None:
        return found[1].replace("''", "'").rstrip()
    word = found[2]
    if word in ("T", "F"):
        return word == "T"
    if re.fullmatch(r"[+-]?[0-9]{1,20}", word):
        return int(word)
    try:
        number = float(re.sub("[dD]", "E", word))
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def keyword_integer(keys: Keys, name: str, default: int = 0) -> int:
    """Return a keyword's whole number; the default where there is none."""
    value = keys.get(name, default)
    return value if isinstance(value, int) else default


def keyword_number(keys: Keys, name: str, default: float) -> float:
    """Return a keyword's number; the default where there is none."""
    value = keys.get(name, default)
    return default if isinstance(value, bool | str) else float(value)


def _data_size(path: Path, keys: Keys) -> int:
    """Return the bytes of a unit's data (section 4.4.1.2)."""
    bits, axes = keyword_integer(keys, "BITPIX"), keyword_integer(keys, "NAXIS", -1)
    if bits not in TYPES or not 0 <= axes <= _MOST_AXES:
        raise damaged_fits(path, f"its header has BITPIX {bits} and NAXIS {axes}")
    if axes == 0:
        return 0
    sizes = [keyword_integer(keys, f"NAXIS{k}", -1) for k in range(1, axes + 1)]
    if min(sizes) < 0:
        raise damaged_fits(path, "its header doesn't say how many numbers an axis has")
    if keys.get("GROUPS") is True and sizes[0] == 0:
        sizes = sizes[1:]
    extra, groups = keyword_integer(keys, "PCOUNT", 0), keyword_integer(keys, "GCOUNT", 1)
    if extra < 0 or groups < 0:
        raise damaged_fits(path, f"its header has PCOUNT {extra} and GCOUNT {groups}")
    return abs(bits) // 8 * groups * (extra + math.prod(sizes))


def damaged_fits(path: Path, why: str) -> UserError:
    """Return the error that says what is wrong with a FITS file."""
    return UserError(f"{path}: is a damaged FITS file: {why}. Get the file again.")


def read_fits(path: Path, data: bytes, page: int = 0) -> StoredPicture:
    """Read a plane of a FITS unit, or three of colours, scaled as its header says.

    page: number of the plane, counted over all units.
    Missing values (BLANK) become NaN. Raises UserError if the file is damaged or cut, or has no
    picture, or one that is compressed.
    """
    units = read_units(path, data)
    pictures = [unit for unit in units if unit.is_picture]
    pages = sum(unit.pages for unit in pictures)
    if not pictures:
        if any(unit.keys.get("ZIMAGE") is True for unit in units):
            raise UserError(
                f"{path}: is a FITS file whose picture is compressed in tiles. Expand it with "
                "funpack."
            )
        kinds = [printable_line(str(one.keys.get("XTENSION", "no data"))) for one in units]
        raise UserError(
            f"{path}: is a FITS file without a picture: it has {', '.join(kinds[:5])}. Give one "
            "with an image of two or three axes."
        )
    if not 0 <= page < pages:
        raise UserError(f"{path}: holds {pages} pictures, counted from 0. Name one of them.")
    rest = page
    for unit in pictures:
        if rest < unit.pages:
            break
        rest -= unit.pages
    kind = np.dtype(TYPES[keyword_integer(unit.keys, "BITPIX")])
    shape = (3 if unit.is_colour else 1, *unit.shape[-2:])
    count = math.prod(shape)
    stored = np.frombuffer(data, kind, count, unit.start + rest * count * kind.itemsize)
    stored = stored.reshape(shape).astype(kind.newbyteorder("="))
    values, notes = _scale(path, stored, unit.keys)
    # A header of its own can leave the exposure to the first one (section 4.4.2, INHERIT).
    keys = {**units[0].keys, **unit.keys}
    white = {"uint8": 255.0, "uint16": 65535.0}.get(values.dtype.name)
    number = "floating point" if values.dtype.kind == "f" else "whole numbers"
    return StoredPicture(
        values,
        f"FITS, {8 * values.dtype.itemsize}-bit {number}",
        white,
        LINEAR,
        "its format",
        pages,
        exif=_exposure(keys),
        notes=(*notes, *_note_order(unit)),
    )


def count_fits_pages(path: Path, data: bytes) -> int:
    """Return how many pictures FITS units have; raise UserError if they are damaged."""
    return sum(unit.pages for unit in read_units(path, data) if unit.is_picture)


def _scale(path: Path, stored: NDArray[Any], keys: Keys) -> tuple[NDArray[Any], list[str]]:
    """Return a page's numbers as BZERO and BSCALE say (section 4.4.2.5), and notes."""
    zero, scale = keyword_number(keys, "BZERO", 0.0), keyword_number(keys, "BSCALE", 1.0)
    if not scale:
        raise damaged_fits(path, "its BSCALE is 0")
    if stored.dtype.kind == "f":
        if (zero, scale) == (0, 1):
            return stored, []
        return (scale * stored + zero).astype(stored.dtype), [_scaled(scale, zero)]
    values, notes = _scale_integers(stored, scale, zero)
    blank = keys.get("BLANK")
    missing = stored == blank if isinstance(blank, int) else np.zeros(1, bool)
    if missing.any():
        values = np.where(missing, np.nan, values)
        notes.append(f"{int(missing.sum())} of its values are missing (BLANK)")
    return values, notes


def _scale_integers(
    stored: NDArray[Any], scale: float, zero: float
) -> tuple[NDArray[Any], list[str]]:
    """Return integers as they are, or with the other sign's range (table 11), or as floats."""
    if (zero, scale) == (0, 1):
        return stored, []
    bits = 8 * stored.dtype.itemsize
    flip = -128.0 if bits == 8 else 2.0 ** (bits - 1)
    if (zero, scale) == (flip, 1):
        # Adding half the range turns the highest bit.
        other = np.dtype(f"{'i' if bits == 8 else 'u'}{bits // 8}")
        bit = np.array(1 << (bits - 1), f"u{bits // 8}")
        return (stored.view(f"u{bits // 8}") ^ bit).view(other), []
    kind = np.float32 if bits <= 16 else np.float64
    return (scale * stored.astype(np.float64) + zero).astype(kind), [_scaled(scale, zero)]


def _scaled(scale: float, zero: float) -> str:
    return f"its numbers were multiplied by {scale:g} (BSCALE), and {zero:g} added (BZERO)"


def _exposure(keys: Keys) -> Exif | None:
    """Return what a header says of the exposure."""
    # Seconds; the first keyword is the common one.
    stated = (keyword_number(keys, name, 0.0) for name in ("EXPTIME", "EXPOSURE"))
    time = next((one for one in stated if one > 0), None)
    iso = keyword_number(keys, "ISOSPEED", 0.0)
    try:
        taken = datetime.fromisoformat(str(keys.get("DATE-OBS", ""))).replace(tzinfo=None)
    except ValueError:
        taken = None
    model = printable_line(str(keys.get("INSTRUME", "")))
    found = Exif(time, iso=iso if iso > 0 else None, model=model, taken=taken)
    return None if found == Exif() else found


def _note_order(unit: FitsUnit) -> list[str]:
    """Return notes on the order of rows, colours and a mosaic, which are all kept."""
    order = str(unit.keys.get("ROWORDER", "")).strip().upper()
    notes = ["FITS counts rows from the bottom, and they are kept in its order"]
    if order == "TOP-DOWN":
        notes = ["its first row is the top one (ROWORDER)"]
    if unit.is_colour:
        notes.append("its three planes were taken as red, green and blue")
    if "BAYERPAT" in unit.keys:
        pattern = quote(unit.keys["BAYERPAT"])
        notes.append(f"it is a mosaic of colours (BAYERPAT {pattern}), which was taken as grey")
    return notes
