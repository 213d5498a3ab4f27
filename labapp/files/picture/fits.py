"""The pictures in FITS files (FITS Standard 4.0, Pence et al., A&A 524, A42, and its update).

A file is a row of units: each has a header of lines of 80 characters, and data. Pictures stand in
the first unit, or in extensions of the type IMAGE; each plane is a page, and three planes of one
unit are red, green and blue. Rows are kept in the file's order.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.plain_text import printable_line, quote
from labapp.files.exif import Exif
from labapp.files.picture.encoding import LINEAR
from labapp.files.picture.fits_units import (
    TYPES,
    FitsUnit,
    Keys,
    damaged_fits,
    keyword_integer,
    keyword_number,
    read_units,
)
from labapp.files.picture.stored import StoredPicture

FITS = b"SIMPLE  ="
"""First bytes of FITS (section 4.4.1.1)."""

_TIMES = ("EXPTIME", "EXPOSURE")
"""Keywords of the exposure time in seconds; the first is the common one."""


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
        raise _no_picture(path, units)
    if not 0 <= page < pages:
        raise UserError(f"{path}: holds {pages} pictures, counted from 0. Name one of them.")
    rest = page
    for unit in pictures:
        if rest < unit.pages:
            break
        rest -= unit.pages
    stored = _read_plane(path, data, unit, rest)
    values, notes = _scale(path, stored, unit.keys)
    # A header of its own can leave the exposure to the first one (section 4.4.2, INHERIT).
    keys = {**units[0].keys, **unit.keys}
    white = {"uint8": 255.0, "uint16": 65535.0}.get(values.dtype.name)
    return StoredPicture(
        values,
        f"FITS, {_words(values.dtype)}",
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


def _no_picture(path: Path, units: list[FitsUnit]) -> UserError:
    """Return the error that says why no unit is a picture."""
    if any(unit.keys.get("ZIMAGE") is True for unit in units):
        return UserError(
            f"{path}: is a FITS file whose picture is compressed in tiles. Expand it with funpack."
        )
    kinds = [printable_line(str(unit.keys.get("XTENSION", "no data"))) for unit in units]
    return UserError(
        f"{path}: is a FITS file without a picture: it has {', '.join(kinds[:5])}. Give one with "
        "an image of two or three axes."
    )


def _read_plane(path: Path, data: bytes, unit: FitsUnit, page: int) -> NDArray[Any]:
    """Return the stored numbers of a page of a unit, (bands, rows, columns)."""
    kind = np.dtype(TYPES[keyword_integer(unit.keys, "BITPIX")])
    rows, columns = unit.shape[-2:]
    bands = 3 if unit.is_colour else 1
    count = bands * rows * columns
    start = unit.start + page * count * kind.itemsize
    stored = np.frombuffer(data, kind, count, start).reshape(bands, rows, columns)
    return stored.astype(kind.newbyteorder("="))


def _scale(path: Path, stored: NDArray[Any], keys: Keys) -> tuple[NDArray[Any], list[str]]:
    """Return a page's numbers as BZERO and BSCALE say (section 4.4.2.5), and notes."""
    zero, scale = keyword_number(keys, "BZERO", 0.0), keyword_number(keys, "BSCALE", 1.0)
    if not scale:
        raise damaged_fits(path, "its BSCALE is 0")
    if stored.dtype.kind == "f":
        if (zero, scale) == (0, 1):
            return stored, []
        return (scale * stored + zero).astype(stored.dtype), [_scaled(scale, zero)]
    blank = keys.get("BLANK")
    missing = stored == blank if isinstance(blank, int) else np.zeros(1, bool)
    values, notes = _scale_integers(stored, scale, zero)
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
    stated = (keyword_number(keys, name, 0.0) for name in _TIMES)
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
    first = (
        "its first row is the top one (ROWORDER)"
        if order == "TOP-DOWN"
        else ("FITS counts rows from the bottom, and they are kept in its order")
    )
    notes = [first]
    if unit.is_colour:
        notes.append("its three planes were taken as red, green and blue")
    if "BAYERPAT" in unit.keys:
        pattern = quote(unit.keys["BAYERPAT"])
        notes.append(f"it is a mosaic of colours (BAYERPAT {pattern}), which was taken as grey")
    return notes


def _words(kind: np.dtype[Any]) -> str:
    """Return a type of numbers in words."""
    bits = 8 * kind.itemsize
    return f"{bits}-bit floating point" if kind.kind == "f" else f"{bits}-bit whole numbers"
