"""A cache of the pictures of a scene, so that each file is read once."""

from __future__ import annotations

from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from labapp.files.reading import read_picture

_pictures: WeakValueDictionary[tuple[str, int], NDArray[np.float32]] = WeakValueDictionary()
"""Pictures by file and time of its last change; each is kept while a target refers to it."""


def cached_picture(file: str) -> NDArray[np.float32]:
    """Return a picture file as linear red, green and blue; read it again only if it has changed.

    Targets of the same picture share one array.
    """
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
