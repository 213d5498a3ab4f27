"""The units of a FITS file: the keywords of their headers, and where their data are.

See FITS Standard 4.0 (Pence et al., A&A 524, A42, 2010, and its update of 2018).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError

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
