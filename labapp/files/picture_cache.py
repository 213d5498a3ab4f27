"""A cache of a scene's pictures, so that each is read once."""

from __future__ import annotations

from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from labapp.files.picture.colour_picture import read_scene_picture
from labapp.files.picture.encoding import parse_encoding

_pictures: WeakValueDictionary[tuple[str, int, str], NDArray[np.float32]] = WeakValueDictionary()
"""Pictures by path, time of the last change and encoding, kept while a target refers to them."""


def cached_picture(file: str, encoding: str | None = None) -> NDArray[np.float32]:
    """Return a picture as linear red, green and blue; read it again only if it has changed.

    encoding: how its numbers stand for light; None for what the file says.
    Targets of the same picture share one array.
    """
    which = (file, _modification_time(file), encoding or "")
    found = _pictures.get(which)
    if found is None:
        found = _pictures[which] = read_scene_picture(
            Path(file), parse_encoding(encoding) if encoding else None
        )
    return found


def _modification_time(file: str) -> int:
    try:
        return Path(file).stat().st_mtime_ns
    except OSError:
        return 0
