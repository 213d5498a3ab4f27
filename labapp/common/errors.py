"""The error that users see, and hints on misspelt words."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from labapp.common.plain_text import shorten

_LONGEST = 2000
"""Characters of a message: 20 lines, as lists of all that would be right have. Chosen."""


class UserError(Exception):
    """Tell the user in one or two lines what is wrong and what to do; longer ones are cut."""

    exit_code = 1
    """Exit code of a command that ends with this error."""

    def __init__(self, message: str) -> None:
        super().__init__(shorten(message, _LONGEST))


class WaitedTooLong(UserError):
    """Tell that a run has ended because nobody mended in time what it waited for."""

    exit_code = 75
    """EX_TEMPFAIL of sysexits(3): what failed may succeed later."""


def suggest_spelling(word: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """Return the hint "Did you mean …?" with the nearest known word; "" if none is similar.

    likeness: least similarity, from 0 (any word) to 1 (the same word).
    """
    near = difflib.get_close_matches(word, list(known), 1, likeness)
    return f"Did you mean {near[0]!r}? " if near else ""
