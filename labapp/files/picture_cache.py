"""Pictures that a scene needs, read once."""

from __future__ import annotations

from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from labapp.files.reading import read_picture

_pictures: WeakValueDictionary[tuple[str, int], NDArray[np.float32]] = WeakValueDictionary()
"""By file and the time of its last change; each lasts while a target is a print of it."""


def cached_picture(file: str) -> NDArray[np.float32]:
    """Linear red, green and blue, read once, though many targets may be prints of it; again
    when the file has changed."""
    which = (file, _modification_time(file))
    found = _pictures.get(which)
    if found is None:
        found = _pictures[which] = read_picture(Path(file))
    return found


def _modification_time(file: str) -> int:
    try:
        return Path(file).stat().st_mtime_ns
    except OSError:
        return 0
