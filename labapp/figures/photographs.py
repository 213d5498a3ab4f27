"""Photographs to measure restorations on: those that lie beside the checkout, else our own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Colours = NDArray[np.float64]

_ROOT = Path(__file__).parents[2]

_KODAK = _ROOT.parent / "shared/data/natural/kodak"

_OWN = (_ROOT / "labapp/data/photograph.jpg", _ROOT / "labapp/data/scenes/motorcycle.jpg")

_HALVED = 2
"""Our own are JPEG: averaged down by so much, which takes the traces of it."""


def colour_photographs() -> list[Colours]:
    """(3, rows, columns), red, green, blue, 0 to 1: Kodak's without loss, where they are there."""
    files = sorted(_KODAK.glob("*.png"))
    if files:
        return [_read(file) for file in files]
    return [_halved(_read(file)) for file in _OWN]


def grey_photograph() -> NDArray[np.float64]:
    """The camera man's (skimage.data.camera), (512, 512); else the middle of our own."""
    try:
        from skimage import data
    except ImportError:
        grey = _read(_OWN[0]).mean(0)
        top, left = ((n - 512) // 2 for n in grey.shape)
        return np.asarray(grey[top : top + 512, left : left + 512])
    camera: Callable[[], NDArray[np.uint8]] = data.camera
    return np.asarray(camera() / 255.0)


def _read(file: Path) -> Colours:
    stored = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if stored is None:
        raise FileNotFoundError(f"{file} is no picture that can be read")
    return np.ascontiguousarray(np.moveaxis(stored[..., ::-1] / 255.0, -1, 0))


def _halved(picture: Colours) -> Colours:
    rows, columns = (n // _HALVED for n in picture.shape[1:])
    cut = picture[:, : rows * _HALVED, : columns * _HALVED]
    return np.asarray(cut.reshape(3, rows, _HALVED, columns, _HALVED).mean((2, 4)))
