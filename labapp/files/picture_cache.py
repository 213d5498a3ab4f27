"""Pictures and numbers that a scene needs, read once."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.files.number_file import read_numbers
from labapp.files.reading import read_picture


def picture_of(file: str) -> NDArray[np.float32]:
    """Linear red, green and blue, read once, though many targets may be prints of it; again
    when the file has changed."""
    return _picture(file, _changed(file))


def numbers_of(file: str, variable: str | None = None) -> NDArray[np.float64]:
    """The numbers of a file, kept as pictures are."""
    return _numbers(file, variable, _changed(file))


@lru_cache(maxsize=2)
def _picture(file: str, changed: int) -> NDArray[np.float32]:
    return read_picture(Path(file))


@lru_cache(maxsize=2)
def _numbers(file: str, variable: str | None, changed: int) -> NDArray[np.float64]:
    return read_numbers(Path(file), variable)


def _changed(file: str) -> int:
    try:
        return Path(file).stat().st_mtime_ns
    except OSError:
        return 0
