"""Find and decode the picture files of folders, for training and for tests of what was trained."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.reading import decode_image

PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"})
"""Endings of the files that are taken to be pictures; other files of a folder are left alone."""

Colours = NDArray[np.uint8]
"""A decoded picture: red, green and blue sRGB values, (3, rows, columns)."""


def list_pictures(folder: Path) -> list[Path]:
    """List the picture files of a folder and the folders in it, sorted by path.

    Hidden files, such as those that a Mac leaves behind, don't count.

    Raises
    ------
    UserError
        If the folder isn't there, or has no picture.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: is not a folder. Name a folder of pictures.")
    found = sorted(_visible_pictures(folder), key=lambda file: file.relative_to(folder).as_posix())
    if not found:
        endings = ", ".join(sorted(PICTURE_SUFFIXES))
        raise UserError(f"{folder}: has no picture. Name a folder of pictures ({endings}).")
    return found


def decode_picture(path: Path) -> Colours:
    """Decode a picture file to 8-bit sRGB colours, (3, rows, columns).

    16-bit values are rounded to 8 bits, and a grey picture gets three equal colours.

    Raises
    ------
    UserError
        If the file can't be read as a picture of 8 or 16 bits.
    """
    values = decode_image(path, colour=True)
    if values is None:
        raise UserError(
            f"{path}: is not a picture that can be read. Take it out of the folder, or replace it."
        )
    if values.dtype == np.uint16:
        values = np.rint(values / 257.0).astype(np.uint8)
    if values.dtype != np.uint8:
        raise UserError(f"{path}: has {values.dtype} values. Give an 8- or 16-bit picture.")
    return np.ascontiguousarray(np.moveaxis(values[..., ::-1], -1, 0))


def _visible_pictures(folder: Path) -> Iterator[Path]:
    """Yield the picture files of a folder that aren't hidden, in no particular order."""
    for file in folder.rglob("*"):
        hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
        if file.suffix.lower() in PICTURE_SUFFIXES and file.is_file() and not hidden:
            yield file
