"""The one parser of numbers that people type or that text files hold.

One point or one comma is the decimal sign, whatever the language of the desktop is, and an exponent
may follow. Signs between groups of digits are refused, since 1.234 is one number to some readers
and a thousand times as much to others.
"""

from __future__ import annotations

import re
from decimal import Decimal

from labapp.common.plain_text import quote

_NUMBER = re.compile(
    r"(?P<sign>[+\-−]?)(?P<digits>[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE](?P<power>[+\-−]?[0-9]+))?"
)
_GROUP_SIGNS = "\u00a0\u202f\u2009\t'’_`\u066c"
"""Signs that languages and programs write between groups of digits, besides point and comma."""

_FURTHER_SIGNS = re.compile(rf"[0-9][{_GROUP_SIGNS} ]+[0-9]")
_GROUPED = (
    re.compile(r"[+\-−]?[0-9]{1,3}(?:\.[0-9]{3})+,[0-9]+"),
    re.compile(r"[+\-−]?[0-9]{1,3}(?:,[0-9]{3})+\.[0-9]+"),
)
"""Numbers with signs between groups of digits and a decimal sign, as in 1.234,5 and 1,234.5."""

_LONGEST = 400
"""Characters of a number: the digits of the largest double are 309."""

_LARGEST = 1e60
"""Size of a number, in whatever unit: the power of a star in photons a second is 1e46. Its square
is less than what doubles hold by far. Chosen."""

_BLANK = re.compile(r"[0-9.]\s+[+\-−.0-9]")
_TIGHT_COMMA, _LOOSE_COMMA = re.compile(r"[0-9],[0-9]"), re.compile(r",\s+[+\-−.0-9]")
"""Blanks between numbers of a list, and commas without and with a blank before a number."""

_SEPARATED = 'put semicolons between numbers, in quotes, as in "1.5;20"'

_RIGHT = "type digits with one point or one comma as the decimal sign, as in 0.5 or 1e3"


def parse_number(text: str, unit: str = "") -> float:
    """Return the number that a person typed; the unit may follow it.

    Raises ValueError that quotes the text, says what is wrong with it and what to type.
    """
    exact = parse_decimal(text, unit)
    number = float(exact)
    if abs(number) > _LARGEST or (number == 0) != (exact == 0):
        raise ValueError(f"{quote(text)} is beyond what can be computed with: {_RIGHT}")
    return number


def parse_whole(text: str, unit: str = "") -> int:
    """Return the whole number that a person typed; ValueError if it has a fraction."""
    exact = parse_decimal(text, unit)
    if exact != exact.to_integral_value():
        raise ValueError(f"{quote(text)} isn't a whole number: type one, as 5")
    return int(exact)


def parse_decimal(text: str, unit: str = "") -> Decimal:
    """Return the number that a person typed, to its last digit; ValueError as by parse_number."""
    # Micro is written with one letter; keyboards and programs have two.
    bare, wanted = (one.strip().replace("\u03bc", "µ") for one in (text, unit))
    bare = bare.removesuffix(wanted).rstrip() if wanted else bare
    found = _NUMBER.fullmatch(bare)
    if found is None or len(bare) > _LONGEST:
        raise ValueError(f"{quote(text)} {_fault(bare, unit)}")
    power = (found["power"] or "0").replace("−", "-")
    if len(power.lstrip("+-0")) > 3:
        raise ValueError(f"{quote(text)} is beyond what can be computed with: {_RIGHT}")
    sign = "-" if found["sign"] in ("-", "−") else ""
    return Decimal(f"{sign}{found['digits'].replace(',', '.')}e{power}")


def parse_list(text: str, count: int | None = None) -> list[float]:
    """Return the numbers of a list that a person typed; `count` is how many there must be.

    Semicolons separate them, or else commas; beside those, the decimal sign is a point. Raises
    ValueError for a single comma that may be a decimal sign, too, and as parse_number does.
    """
    parts = split_list(text)
    if count is not None and len(parts) != count:
        raise ValueError(f"{quote(text)} has {len(parts)} numbers, and must have {count}")
    # A single comma may be a decimal sign or stand between groups of digits.
    bare, forms = text.strip(), (_NUMBER, *_GROUPED)
    if count is None and bare.count(",") == 1 and any(one.fullmatch(bare) for one in forms):
        raise ValueError(
            f"{quote(text)} may be one number or two: type one with a point and no other sign, or "
            f'two with a semicolon, in quotes, as "{bare.replace(",", ";")}"'
        )
    return [parse_number(one) for one in parts]


def split_list(text: str) -> list[str]:
    """Return the parts of a list that a person typed, by semicolons, or else by commas.

    A comma with a blank after it only separates. Raises ValueError for blanks alone between
    numbers, and for commas with blanks beside commas without, which may be decimal signs.
    """
    parts = text.split(";" if ";" in text else ",")
    if any(_BLANK.search(one) for one in parts):
        raise ValueError(f"{quote(text)} has only blanks between numbers: {_SEPARATED}")
    if ";" not in text and _TIGHT_COMMA.search(text) and _LOOSE_COMMA.search(text):
        raise ValueError(
            f"{quote(text)} has commas with and without a blank, of which some may be decimal "
            f"signs: {_SEPARATED}"
        )
    return parts


def _fault(text: str, unit: str) -> str:
    """Say what is wrong with a text that is no number, and what to type."""
    if not text:
        return f"holds no number: {_RIGHT}"
    if any(one.isnumeric() and not one.isascii() for one in text):
        return "has digits of another script: type 0 to 9"
    if "." in text and "," in text:
        return f"has both a point and a comma: {_RIGHT}, and no sign between groups of digits"
    if max(text.count("."), text.count(",")) > 1 or _FURTHER_SIGNS.search(text):
        return f"has several signs among its digits: {_RIGHT}"
    if begun := _NUMBER.match(text):
        rest = quote(text[begun.end() :].strip())
        if unit.strip():
            return f"has {rest} after its number: type the number of {unit.strip()} alone"
        return f"has {rest} after its number: type the number alone"
    return f"isn't a number: {_RIGHT}"
