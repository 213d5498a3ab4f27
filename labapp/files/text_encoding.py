"""Text by programs that don't say how they encode it.

A byte order mark says it; UTF-16 and UTF-32 without one show by their zeros (the Unicode Standard,
section 3.10), and what is valid UTF-8 is UTF-8. Other text has one byte a letter, by Windows' code
page 1252, which holds Latin-1, or by Mac OS Roman.
"""

from __future__ import annotations

import re

UNTOLD = "\ufffd"
"""Stands for each byte whose letter can't be told."""

_MARKS = (
    (b"\xff\xfe\0\0", "utf-32-le"),
    (b"\0\0\xfe\xff", "utf-32-be"),
    (b"\xef\xbb\xbf", "utf-8"),
    (b"\xff\xfe", "utf-16-le"),
    (b"\xfe\xff", "utf-16-be"),
)
_ZEROS = {"utf-32-le": (4, 0), "utf-32-be": (4, 3), "utf-16-le": (2, 0), "utf-16-be": (2, 1)}
"""Bytes of a letter, and the one of them that isn't zero in ASCII letters."""

_CONTROLS = re.compile(r"[\0-\x08\x0e-\x1a\x1c-\x1f\x7f]")
"""Characters that no text has; a line may end with any of its signs."""

_SIGNS = "°±²³µ·¹º×÷§©®£€¥–—‘’“”…«»\u00a0"
_USUAL = {"cp1252": _SIGNS, "mac_roman": _SIGNS + "≤≥∞πΩ√≈∆"}
"""Signs beside letters that tables have in their headings; others mean another encoding."""

_CAPITAL_WITHIN = re.compile(r"[^\W\d_A-Z](?=[À-ÖØ-ÞŸ])[^\W\d_]")
"""A capital beyond ASCII after a small letter."""

_WORD = re.compile(r"[^\W\d_]+")


def decode_text(data: bytes) -> str | None:
    """Decode UTF-8, UTF-16 or UTF-32; None if the bytes are none of them."""
    for mark, name in _MARKS:
        if data.startswith(mark):
            return _decode_as(name, data[len(mark) :])
    if b"\0" in data:
        return next((text for one in _ZEROS if (text := _decode_by_zeros(one, data))), None)
    return _decode_as("utf-8", data)


def decode_byte_text(data: bytes) -> str | None:
    """Decode bytes of which each is a letter; None if they aren't text.

    Letters that can't be told are UNTOLD.
    """
    if _CONTROLS.search(data.decode("latin-1")):
        return None
    # Before Unix, Macs ended lines by CR alone.
    is_old = b"\r" in data and b"\n" not in data
    names = ("mac_roman", "cp1252") if is_old else ("cp1252", "mac_roman")
    found = (text for name in names if (text := _decode_as(name, data)) and _is_usual(name, text))
    return next(found, data.decode("ascii", errors="replace"))


def _decode_as(name: str, data: bytes) -> str | None:
    """Decode bytes in an encoding; None if they aren't text in it."""
    try:
        text = data.decode(name).removesuffix("\x1a")
    except UnicodeDecodeError:
        return None
    wide = name in _ZEROS
    if "\0" in text or (wide and (_CONTROLS.search(text) or not re.search("[!-~]", text))):
        return None
    return text


def _decode_by_zeros(name: str, data: bytes) -> str | None:
    """Decode bytes if their zeros stand where an encoding has them."""
    size, place = _ZEROS[name]
    letters = len(data) // size
    zeros = [data[k::size].count(0) for k in range(size)]
    if len(data) % size or zeros[place] or min(zeros[:place] + zeros[place + 1 :]) < letters / 2:
        return None
    return _decode_as(name, data)


def _is_usual(name: str, text: str) -> bool:
    """Return whether the letters beyond ASCII stand in words, as in a language."""
    if any(not (one.isascii() or one.isalpha() or one in _USUAL[name]) for one in text):
        return False
    if set(text) & set("ŠŽŸšžƒˆ˜ªº¡¿") or _CAPITAL_WITHIN.search(text):
        return False
    return all(
        len(word) == 1 or 2 * sum(not one.isascii() for one in word) <= len(word)
        for word in _WORD.findall(text)
    )
