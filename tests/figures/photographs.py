"""Photographs to measure restorations on."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROOT = Path(__file__).parents[2]

_BESIDE = _ROOT.parent / "shared/data/natural"

_PACKAGED = ("photograph.jpg", "scenes/motorcycle.jpg")
"""Our own, JPEG: halved, which takes the traces of it."""

_SETS = ("set12", "mcmaster", "cbsd68")
"""Test pictures of the field, where they lie beside the checkout."""

_OWN = (
    "astronaut.png", "camera.png", "chelsea.png", "coffee.png", "rocket.jpg", "motorcycle_left.png",
    "moon.png", "coins.png", "ihc.png", "hubble_deep_field.jpg", "retina.jpg", "brick.png",
)  # fmt: skip
"""Of scikit-image's: two squares each."""

_FIVE = ("astronaut.png", "camera.png", "chelsea.png", "coffee.png", "rocket.jpg")
"""Of scikit-image's: photographs of people, an animal, things and a landscape."""

_LARGEST = 640
"""Samples of a picture's longer side; larger ones are averaged down."""


def camera() -> Array | None:
    """The picture of 512 x 512 that everybody measures on, white at 1; None without
    scikit-image."""
    folder = _scikit_image()
    return None if folder is None else _grey(folder / "camera.png")


def squares(count: int, side: int) -> tuple[list[Array], str]:
    """So many squares of grey pictures that no network of ours has learned from, white at 1, and
    where they are from; none where there is nothing."""
    files = _files_beside(_SETS)
    found = list(_cut(files, side, 1))
    if len(found) >= count:
        chosen = np.linspace(0, len(found) - 1, count).round().astype(int)
        return [found[number] for number in chosen], "of Set12, McMaster and CBSD68"
    folder = _scikit_image()
    if folder is None:
        return [], "not measured: scikit-image isn't installed"
    found = list(_cut([folder / name for name in _OWN if (folder / name).is_file()], side, 2))
    return found[:count], "of scikit-image's pictures"


def five_squares(side: int) -> list[Array]:
    """The middle squares of five of scikit-image's photographs, white at 1; none without it."""
    folder = _scikit_image()
    if folder is None:
        return []
    found = [_grey(folder / name) for name in _FIVE]
    return [_middle(one, side) for one in found if one is not None]


def _middle(picture: Array, side: int) -> Array:
    y, x = (max((n - side) // 2, 0) for n in picture.shape)
    return picture[y : y + side, x : x + side]


def collection_words(names: tuple[str, ...]) -> str:
    """Where grey_pictures() takes these collections' pictures from, in words."""
    if _files_beside(names):
        return f"of {', '.join(names)}"
    return "of scikit-image's and our own pictures"


def _files_beside(names: tuple[str, ...]) -> list[Path]:
    return [file for name in names for file in sorted((_BESIDE / name).glob("*.*"))]


def grey_pictures(names: tuple[str, ...]) -> list[Array]:
    """Grey pictures of these collections, white at 1, where they lie beside the checkout; the
    project's own and scikit-image's otherwise."""
    files = _files_beside(names)
    if not files:
        folder = _scikit_image()
        files = [_ROOT / "labapp/data" / name for name in _PACKAGED]
        files += [] if folder is None else [folder / name for name in _OWN]
    found = [picture for file in files if (picture := _grey(file)) is not None]
    return [_averaged_down(picture) for picture in found]


def colour_photographs() -> list[Array]:
    """(3, rows, columns), red, green, blue, 0 to 1: Kodak's without loss, where they lie beside
    the checkout."""
    files = sorted((_BESIDE / "kodak").glob("*.png"))
    if files:
        return [_colours(file) for file in files]
    return [_halved(_colours(_ROOT / "labapp/data" / name)) for name in _PACKAGED]


def _colours(file: Path) -> Array:
    stored = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if stored is None:
        raise FileNotFoundError(f"{file} is no picture that can be read")
    return np.ascontiguousarray(np.moveaxis(stored[..., ::-1] / 255.0, -1, 0))


def _halved(picture: Array) -> Array:
    size = [n // 2 for n in picture.shape[:0:-1]]
    return np.stack([cv2.resize(band, size, interpolation=cv2.INTER_AREA) for band in picture])


def _scikit_image() -> Path | None:
    found = importlib.util.find_spec("skimage")
    return None if found is None or found.origin is None else Path(found.origin).parent / "data"


def _grey(file: Path) -> Array | None:
    stored = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    return None if stored is None else np.asarray(stored, dtype=np.float64) / 255


def _averaged_down(picture: Array) -> Array:
    """The picture with at most _LARGEST samples along its longer side."""
    shrunk = _LARGEST / max(picture.shape)
    if shrunk >= 1:
        return picture
    size = [round(n * shrunk) for n in picture.shape[::-1]]
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))


def _cut(files: list[Path], side: int, each: int) -> Iterator[Array]:
    """The first and the last square along the longer side, or that in the middle."""
    for file in files:
        picture = _grey(file)
        if picture is None:
            continue
        picture = _averaged_down(picture)
        if min(picture.shape) < side:
            continue
        for share in (0.5,) if each == 1 else np.linspace(0, 1, each):
            y, x = (round(share * (n - side)) for n in picture.shape)
            yield picture[y : y + side, x : x + side]
