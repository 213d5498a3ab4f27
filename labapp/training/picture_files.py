"""Find the picture files of folders, for training and for tests of what was trained."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from labapp.common.errors import UserError

PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"})
"""Endings of the files that are taken to be pictures; other files of a folder are left alone."""


def list_pictures(folder: Path) -> list[Path]:
    """List the pictures of a folder and the folders in it, sorted by path.

    Hidden files, such as those that a Mac leaves behind, don't count. Raises UserError if the
    folder isn't there, or has no picture.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: is not a folder. Name a folder of pictures.")
    found = sorted(_visible_pictures(folder), key=lambda file: file.relative_to(folder).as_posix())
    if not found:
        endings = ", ".join(sorted(PICTURE_SUFFIXES))
        raise UserError(f"{folder}: has no picture. Name a folder of pictures ({endings}).")
    return found


def _visible_pictures(folder: Path) -> Iterator[Path]:
    """Yield the pictures of a folder that aren't hidden, in no particular order."""
    for file in folder.rglob("*"):
        hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
        if file.suffix.lower() in PICTURE_SUFFIXES and file.is_file() and not hidden:
            yield file
