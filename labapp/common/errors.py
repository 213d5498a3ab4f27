"""What went wrong, said to a person."""

from __future__ import annotations


class UserError(Exception):
    """One or two lines that say what is wrong and what to do about it."""
