"""The error for pictures that can't be read rightly, which names what they are."""

from __future__ import annotations

from pathlib import Path

from labapp.common.errors import UserError

_REMEDY = "Save it as PNG, or as TIFF of grey or of red, green and blue."


def refuse_picture(path: Path, what: str, remedy: str = _REMEDY) -> UserError:
    """Return the error that says what a picture file is, and what to do."""
    return UserError(f"{path}: is {what}. {remedy}")
