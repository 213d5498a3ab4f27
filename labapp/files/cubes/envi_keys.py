"""The keys and values of an ENVI header, as text and as numbers.

Lines are "key = value", or "key = {values}" over several lines; keys are written in any case, and a
line that begins with a semicolon is a comment (NV5 Geospatial, "ENVI Header Files").
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.files.text_table import parse_numbers

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
