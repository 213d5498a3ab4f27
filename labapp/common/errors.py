"""What went wrong, said to a person."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class UserError(Exception):
    """One or two lines that say what is wrong and what to do about it."""


def suggest_spelling(word: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """Ask whether the known word that is most like one was meant; empty if none is like it.

    likeness: of two words, from 0 for any to 1 for the same.
    """
    near = difflib.get_close_matches(word, list(known), 1, likeness)
    return f"Did you mean {near[0]!r}? " if near else ""
