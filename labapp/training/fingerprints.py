"""Describe test pictures by fingerprints, from which copies of them are recognised.

A fingerprint holds two small grey thumbnails, of which only fine structure of equal local contrast
is kept. Brightness and colours are gone, and smooth parts, which many photographs share, count
little. It is some kilobytes, so that those of public test pictures come with the application, and
too coarse to be used as a picture.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.array_file import read_npz
from labapp.files.picture.colour_picture import Colours, read_screen_colours
from labapp.files.writing import write_atomically
from labapp.training.manifest import list_pictures

Thumbnail = NDArray[np.float32]

FINE_SIDE = 80
"""Longest side of a fingerprint's finer thumbnail, in pixels. Measured with 64 pixels instead: the
scores of photographs that aren't copies were up to 0.61, instead of 0.53."""

COARSE_SIDE = 40
"""Longest side of a fingerprint's coarser thumbnail, in pixels. Measured with 32 pixels instead:
some copies that were cropped to half of each side scored 0.05 less; with 40, none did."""

UNITS = 8
"""Levels of a stored thumbnail for one unit of local contrast, which reaches about 3."""

_DETAIL_SIGMAS = (0.7, 2.0)
"""Standard deviations in pixels of the two Gaussians between which structure is kept: periods of
about 4 to 12 pixels, which survive strong compression and small displacements. Chosen."""

_CONTRAST_SIGMA = 4.0
"""Standard deviation in pixels of the Gaussian within which contrast is made equal. Chosen."""

_CONTRAST_FLOOR = 0.25
"""Share of a picture's mean contrast below which local contrast isn't raised to 1. Chosen."""

_LEAST_CONTRAST = 0.05
"""Contrast in grey levels of 255 that isn't raised to 1 in any picture. Chosen: a plain picture has
less, from rounding."""

_VERSION = 1
"""Version of the layout in which fingerprints are written."""


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """What is kept of a test picture: two whitened grey thumbnails, which show its edges only.

    fine, coarse: (rows, columns), with a longest side of 80 and 40 pixels; `UNITS` levels for one
    unit of local contrast.
    """

    name: str
    fine: NDArray[np.int8]
    coarse: NDArray[np.int8]


def fingerprint(picture: Colours, name: str) -> Fingerprint:
    """Compute the fingerprint of a test picture.

    picture: colours, (3, rows, columns).
    name: of the picture, for error messages.
    """
    grey = average_colours(picture)
    fine, coarse = (
        np.clip(
            np.rint(UNITS * whiten(resize_grey(grey, fitted_shape(grey.shape, side)))), -127, 127
        ).astype(np.int8)
        for side in (FINE_SIDE, COARSE_SIDE)
    )
    return Fingerprint(name, fine, coarse)


def read_test_fingerprints(paths: Sequence[Path]) -> list[Fingerprint]:
    """Compute or read the fingerprints of test pictures.

    Raises UserError if a path is missing or isn't any of these.
    paths: pictures, folders of pictures, and files of `write_fingerprints`, which end in .npz.
    """
    found = []
    for path in paths:
        if path.suffix.lower() == ".npz":
            found += _read_fingerprint_file(path)
        else:
            files = list_pictures(path) if path.is_dir() else [path]
            found += [fingerprint(read_screen_colours(file), file.name) for file in files]
    return found


def write_fingerprints(path: Path, fingerprints: Sequence[Fingerprint]) -> None:
    """Write fingerprints to an .npz file, which `read_test_fingerprints` reads."""
    arrays: dict[str, NDArray[np.generic]] = {
        "version": np.array(_VERSION),
        "names": np.array([one.name for one in fingerprints]),
    }
    for index, one in enumerate(fingerprints):
        arrays[f"fine_{index}"], arrays[f"coarse_{index}"] = one.fine, one.coarse
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getvalue())


def _read_fingerprint_file(path: Path) -> list[Fingerprint]:
    """Read a file of fingerprints; raise UserError if it isn't one."""
    wrong = UserError(
        f"{path}: is not a file of fingerprints. Name one that labapp wrote, a picture or a folder."
    )
    try:
        arrays = read_npz(path)
        names = [str(name) for name in arrays["names"]]
        pairs = [(arrays[f"fine_{i}"], arrays[f"coarse_{i}"]) for i in range(len(names))]
        version = int(arrays["version"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise wrong from error
    if version != _VERSION:
        raise UserError(
            f"{path}: has version {version} of fingerprints; this program reads {_VERSION}. Make "
            "the file anew from the pictures."
        )
    for pair in pairs:
        for array, side in zip(pair, (FINE_SIDE, COARSE_SIDE), strict=True):
            if array.dtype != np.int8 or array.ndim != 2 or max(array.shape) != side:
                raise wrong
    return [Fingerprint(name, *pair) for name, pair in zip(names, pairs, strict=True)]


def average_colours(picture: NDArray[np.uint8]) -> Thumbnail:
    """Return the mean of a picture's colours, (rows, columns), at most 4 thumbnails wide.

    A large picture is averaged down first, which saves memory and time.
    """
    scale = min(1.0, 4 * FINE_SIDE / max(picture.shape[1:]))
    rows, columns = (max(1, round(n * scale)) for n in picture.shape[1:])
    bands = [resize_grey(np.ascontiguousarray(band), (rows, columns)) for band in picture]
    return np.mean(np.stack(bands), 0, dtype=np.float32)


def resize_grey(values: NDArray[np.uint8] | Thumbnail, shape: tuple[int, int]) -> Thumbnail:
    """Return a picture averaged down, or interpolated up, to (rows, columns)."""
    shrinks = shape[0] < values.shape[0] or shape[1] < values.shape[1]
    way = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    resized: Thumbnail = cv2.resize(values, shape[::-1], interpolation=way).astype(np.float32)
    return resized


def whiten(thumbnail: Thumbnail) -> Thumbnail:
    """Return the fine structure of a thumbnail, with nearly the same contrast everywhere."""

    def blur(values: Thumbnail, sigma: float) -> Thumbnail:
        """Blur by a Gaussian with a standard deviation in pixels."""
        smooth = cv2.GaussianBlur(values, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
        return np.asarray(smooth, np.float32)

    detail = blur(thumbnail, _DETAIL_SIGMAS[0]) - blur(thumbnail, _DETAIL_SIGMAS[1])
    contrast = np.sqrt(blur(detail * detail, _CONTRAST_SIGMA))
    # What is below a quarter of the picture's mean contrast may be noise.
    floor = _CONTRAST_FLOOR * float(contrast.mean()) + _LEAST_CONTRAST
    return np.asarray(detail / (contrast + floor), np.float32)


def fitted_shape(shape: tuple[int, ...], side: float) -> tuple[int, int]:
    """Return a picture's rows and columns after its longest side was resized to `side` pixels."""
    scale = side / max(shape)
    return max(8, round(shape[0] * scale)), max(8, round(shape[1] * scale))
