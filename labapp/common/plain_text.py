"""Keeps texts from files and devices text: what would control a terminal or a page is replaced.

A name, title or message may hold anything. Every way out (terminal, window, page, picture) passes
texts through here, or has its markup switched off.
"""

from __future__ import annotations

import re
import shlex

_CONTROLS = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f"  # C0 and C1 controls but the line feed; DEL
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # controls of the direction of writing
    "\u2028\u2029\ufeff"  # separators of lines and paragraphs, and the byte order mark
    "\ud800-\udfff]"  # halves of characters, which can't be encoded
)
"""Characters that control what shows a text, and those that can't be written (Unicode 15, chapter
23). The line feed is left, since messages have several lines."""

_LONGEST_QUOTE = 200
"""Characters of a value that an error quotes; three lines of a terminal. Chosen."""


def printable(text: str) -> str:
    """Replace each character that would control a terminal or page by a blank; line feeds stay."""
    return _CONTROLS.sub(" ", text)


def printable_line(text: str) -> str:
    """Replace control characters by blanks, line feeds included: a name is one line."""
    return printable(text).replace("\n", " ")


def quote(value: object) -> str:
    """Return a value by repr(), as errors quote it, in at most 200 characters."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        # Python doesn't write whole numbers of more than 4300 digits.
        return f"a {type(value).__name__}"
    return shorten(text, _LONGEST_QUOTE)


def shorten(text: str, most: int) -> str:
    """Leave out the middle of a text that has more than `most` characters."""
    return text if len(text) <= most else f"{text[: most // 2]} … {text[-(most // 2) :]}"


def shell_word(value: object) -> str:
    """Return a name or path as one word of a command that a person types."""
    return shlex.quote(printable_line(str(value)))
