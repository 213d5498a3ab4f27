"""The portable maps PBM, PGM, PPM, PAM and PFM, whose definitions are Netpbm's.

See netpbm.sourceforge.net/doc for all but PFM, and P. Debevec's HDR Shop for that. Levels are kept
as they are stored, with their own number of white.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.files.picture.encoding import LINEAR
from labapp.files.picture.stored import StoredPicture

_NAMES = {
    b"P1": "PBM", b"P2": "PGM", b"P3": "PPM", b"P4": "PBM", b"P5": "PGM", b"P6": "PPM",
    b"P7": "PAM", b"Pf": "PFM", b"PF": "PFM",
}  # fmt: skip
"""Names of the formats by the first two bytes."""

_TEXTS, _BITS, _FLOATS = (b"P1", b"P2", b"P3"), (b"P1", b"P4"), (b"Pf", b"PF")
_COLOURS = (b"P3", b"P6", b"PF")

_WORD = re.compile(rb"(?:\s|#[^\n]*\n)*([^\s#]+)")
"""A word of a header, with blanks and comments before it."""

_END = re.compile(rb"(?:#[^\n]*\n)?\s")
_MOST_WHITE = 65535

_TUPLES = {
    b"BLACKANDWHITE": (1, 1), b"GRAYSCALE": (1, 1), b"RGB": (3, 3),
    b"BLACKANDWHITE_ALPHA": (2, 1), b"GRAYSCALE_ALPHA": (2, 1), b"RGB_ALPHA": (4, 3),
}  # fmt: skip
"""Samples of a pixel by PAM's type of tuple, and how many of them are grey or colour."""


@dataclass(frozen=True)
class _Header:
    """What a header says of the numbers behind it: samples of a pixel (depth), how many of them
    are light (bands), the highest level (white), PFM's scale, whose sign tells the order of bytes,
    and the place of the pixels (start).
    """

    magic: bytes
    columns: int
    rows: int
    depth: int
    bands: int
    white: int
    scale: float
    start: int

    @property
    def number_type(self) -> np.dtype[Any]:
        """The type of a stored sample."""
        if self.magic in _FLOATS:
            return np.dtype("<f4" if self.scale < 0 else ">f4")
        return np.dtype("u1" if self.white < 256 else ">u2")

    @property
    def size(self) -> int:
        """Bytes of the pixels, where they aren't text."""
        if self.magic == b"P4":
            return self.rows * ((self.columns + 7) // 8)
        return self.rows * self.columns * self.depth * self.number_type.itemsize


def is_netpbm(data: bytes) -> bool:
    """Return whether bytes begin as a portable map does."""
    return data[:2] in _NAMES and data[2:3] in (b" ", b"\t", b"\n", b"\r", b"#")


def read_netpbm(path: Path, data: bytes, page: int = 0) -> StoredPicture:
    """Read a portable map; a file can hold several after each other.

    The rows of PFM are put from top to bottom. White is the highest number that the header states;
    how levels stand for light isn't said by the file, but in PFM, which holds light. Raises
    UserError if the file is damaged or cut.
    """
    headers = _read_headers(path, data)
    if not 0 <= page < len(headers):
        raise UserError(f"{path}: holds {len(headers)} pictures, counted from 0. Name one of them.")
    header = headers[page]
    read = _read_text if header.magic in _TEXTS else _read_bytes
    values = read(path, data, header)
    notes = []
    if header.depth > header.bands:
        notes.append("its transparency was left out; its light was not multiplied by it")
        values = values[: header.bands]
    name = _NAMES[header.magic]
    if header.magic not in _FLOATS:
        kind = f"{name} with levels from 0 to {header.white}"
        return StoredPicture(values, kind, header.white, pages=len(headers), notes=tuple(notes))
    if abs(header.scale) != 1:
        notes.append(f"its scale of {abs(header.scale):g} was not applied, since programs differ")
    return StoredPicture(values, name, None, LINEAR, "its format", len(headers), notes=tuple(notes))


def count_netpbm_pages(path: Path, data: bytes) -> int:
    """Return how many portable maps there are; raise UserError if one is damaged."""
    return len(_read_headers(path, data))


def _read_headers(path: Path, data: bytes) -> list[_Header]:
    """Return the headers of all maps in a file; text can only be one."""
    found = [_read_header(path, data, 0)]
    while found[-1].magic not in _TEXTS:
        end = found[-1].start + found[-1].size
        if end > len(data):
            raise _damaged(path, "its pixels end early")
        if not is_netpbm(data[end : end + 3]):
            break
        found.append(_read_header(path, data, end))
    return found


def _read_header(path: Path, data: bytes, at: int) -> _Header:
    """Return the header that begins at a place of the file."""
    magic = data[at : at + 2]
    if magic == b"P7":
        return _read_pam_header(path, data, at)
    words, end = _words(path, data, at + 2, 2 if magic in _BITS else 3)
    columns, rows = (_whole(path, one) for one in words[:2])
    white, scale = 1, 1.0
    if magic in _FLOATS:
        try:
            scale = float(words[2])
        except ValueError:
            scale = math.nan
        if not math.isfinite(scale) or scale == 0:
            raise _damaged(path, f"its scale is {quote(words[2].decode('latin-1'))}")
    elif magic not in _BITS:
        white = _white(path, words[2])
    bands = 3 if magic in _COLOURS else 1
    return _Header(magic, columns, rows, bands, bands, white, scale, end)


def _words(path: Path, data: bytes, at: int, count: int) -> tuple[list[bytes], int]:
    """Return words of a header from a place on, and the place after the blank behind them."""
    words = []
    for _ in range(count):
        found = _WORD.match(data, at, at + 10_000)
        if not found:
            raise _damaged(path, "its header ends early")
        words.append(found[1])
        at = found.end()
    blank = _END.match(data, at)
    return words, blank.end() if blank else at


def _read_pam_header(path: Path, data: bytes, at: int) -> _Header:
    """Return a PAM header: lines of names and values."""
    end = data.find(b"ENDHDR\n", at, at + 10_000)
    if end < 0:
        raise _damaged(path, "its header ends early")
    lines = [line.split(None, 1) for line in data[at:end].split(b"\n")[1:]]
    values = {line[0]: line[1].strip() for line in lines if len(line) == 2}
    depth = _whole(path, values.get(b"DEPTH", b""))
    kind = values.get(b"TUPLTYPE", {1: b"GRAYSCALE", 3: b"RGB"}.get(depth, b""))
    stated, bands = _TUPLES.get(kind, (0, 0))
    if stated != depth:
        raise UserError(
            f"{path}: is a PAM picture of {depth} samples a pixel of the type "
            f"{quote(kind.decode('latin-1'))}. Save it as grey or as RGB."
        )
    columns, rows = (_whole(path, values.get(name, b"")) for name in (b"WIDTH", b"HEIGHT"))
    white = _white(path, values.get(b"MAXVAL", b""))
    return _Header(b"P7", columns, rows, depth, bands, white, 1.0, end + len(b"ENDHDR\n"))


def _read_text(path: Path, data: bytes, header: _Header) -> NDArray[Any]:
    """Return levels that are written as digits, (bands, rows, columns)."""
    count = header.rows * header.columns * header.depth
    body = re.sub(rb"#[^\n]*", b"", data[header.start :])
    if header.magic == b"P1":
        # Digits needn't have blanks between.
        digits = np.frombuffer(body, np.uint8)
        bits = digits[(digits == ord("0")) | (digits == ord("1"))] - ord("0")
        if bits.size < count:
            raise _damaged(path, "its pixels end early")
        return 1 - bits[:count].reshape(1, header.rows, header.columns)
    if len(body) < count:
        raise _damaged(path, "its pixels end early")
    words = body.split(None, count)[:count]
    try:
        numbers = np.array(words, dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise _damaged(path, "its pixels aren't whole numbers") from error
    if numbers.size < count or numbers.min() < 0 or numbers.max() > header.white:
        raise _damaged(path, f"its pixels aren't {count} numbers from 0 to {header.white}")
    shape = (header.rows, header.columns, header.depth)
    kind = np.uint8 if header.white < 256 else np.uint16
    return np.moveaxis(numbers.astype(kind).reshape(shape), -1, 0)


def _read_bytes(path: Path, data: bytes, header: _Header) -> NDArray[Any]:
    """Return numbers that are stored as bytes, (samples, rows, columns)."""
    kind, start = header.number_type, header.start
    if header.magic == b"P4":
        stored = np.frombuffer(data, np.uint8, header.size, start).reshape(header.rows, -1)
        # A bit that is set is black.
        return 1 - np.unpackbits(stored, axis=1, count=header.columns)[None]
    numbers = np.frombuffer(data, kind, header.size // kind.itemsize, start)
    values = np.moveaxis(numbers.reshape(header.rows, header.columns, header.depth), -1, 0)
    if header.magic in _FLOATS:
        values = values[:, ::-1]
    elif values.max() > header.white:
        raise _damaged(path, f"its pixels have numbers above {header.white}")
    return values.astype(kind.newbyteorder("="))


def _whole(path: Path, word: bytes) -> int:
    """Return a number of pixels or samples, 1 or more."""
    if not re.fullmatch(rb"[0-9]{1,9}", word) or not int(word):
        raise _damaged(path, f"a size in its header is {quote(word.decode('latin-1'))}")
    return int(word)


def _white(path: Path, word: bytes) -> int:
    """Return the highest level that a header states."""
    if (white := _whole(path, word)) > _MOST_WHITE:
        raise _damaged(path, f"its highest level is {white}, above {_MOST_WHITE}")
    return white


def _damaged(path: Path, why: str) -> UserError:
    return UserError(f"{path}: is a damaged portable map: {why}. Get the file again.")
