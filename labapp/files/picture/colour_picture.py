"""Pictures as colours: of a scene in linear light, or 8-bit ones of a screen for training."""

from __future__ import annotations

from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from labapp.common.console import print_message
from labapp.common.errors import UserError
from labapp.files.picture.encoding import SRGB, Encoding, encode_srgb, parse_encoding
from labapp.files.picture.photograph import read_photograph

Colours = NDArray[np.uint8]
"""A decoded picture: red, green and blue sRGB values, (3, rows, columns)."""


def read_scene_picture(path: Path, encoding: Encoding | None = None) -> NDArray[np.float32]:
    """Read linear red, green and blue, (rows, columns, 3), white at 1.

    encoding: how the numbers stand for light; None for what the file says.
    Raises UserError for what can't be read, or can't be light.
    """
    picture = read_photograph(path, encoding=encoding)
    light = picture.relative_light
    _require_light(path, light)
    if picture.white is None and (brightest := float(light.max())) > 1:
        print_message(
            f"note: {path}: has light up to {brightest:.3g} times white, which is 1 in "
            "floating-point pictures"
        )
    colours = np.broadcast_to(light, (3, *light.shape[1:]))
    return np.array(np.moveaxis(colours, 0, -1), order="C")


def read_screen_colours(path: Path) -> Colours:
    """Read 8-bit sRGB colours, (3, rows, columns); grey gets three equal ones.

    Raises UserError for what can't be read, or is brighter than white.
    """
    picture = read_photograph(path)
    if picture.levels.dtype == np.uint8 and picture.encoding.name == SRGB.name:
        levels = picture.levels
    else:
        light = picture.relative_light
        _require_light(path, light)
        if light.max() > 1:
            raise UserError(
                f"{path}: has light up to {light.max():.3g} times white, which 8-bit colours don't "
                "hold. Scale it to at most 1."
            )
        levels = np.rint(255 * encode_srgb(light)).astype(np.uint8)
    # A copy, which may be written to.
    return np.array(np.broadcast_to(levels, (3, *levels.shape[1:])))


def read_drawing(path: Path) -> NDArray[np.uint8]:
    """Read 8-bit grey levels of a drawing, (rows, columns): of colours, their luma.

    Raises UserError for what can't be read, or is brighter than white.
    """
    red, green, blue = read_screen_colours(path)
    if np.array_equal(red, green) and np.array_equal(red, blue):
        return red
    # Luma of ITU-R BT.601, as programs make pictures grey.
    return np.rint(0.299 * red + 0.587 * green + 0.114 * blue).astype(np.uint8)


def _require_light(path: Path, light: NDArray[np.float32]) -> None:
    """Raise UserError unless numbers can be light: finite, and not below 0."""
    if not np.isfinite(light).all():
        raise UserError(f"{path}: has NaN or infinite values. Fill them before it is shown.")
    if light.min() < 0:
        raise UserError(
            f"{path}: has values down to {light.min():.3g}, and light isn't negative. Cut them "
            "off at 0 before it is shown."
        )


_pictures: WeakValueDictionary[tuple[str, int, str], NDArray[np.float32]] = WeakValueDictionary()
"""Pictures by path, time of the last change and encoding, kept while a target refers to them."""


def cached_picture(file: str, encoding: str | None = None) -> NDArray[np.float32]:
    """Return a picture as linear red, green and blue; read it again only if it has changed."""
    try:
        changed = Path(file).stat().st_mtime_ns
    except OSError:
        changed = 0
    which = (file, changed, encoding or "")
    found = _pictures.get(which)
    if found is None:
        found = _pictures[which] = read_scene_picture(
            Path(file), parse_encoding(encoding) if encoding else None
        )
    return found
