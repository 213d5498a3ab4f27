"""Read photographs for the denoiser, and cut random grey patches from them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.colour_picture import read_screen_colours

_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}

Colours = NDArray[np.float32]


def read_training_pictures(folders: Sequence[Path]) -> list[Colours]:
    """Read every picture of folders and files, (3, rows, columns), 0 to 1.

    Each picture is returned at scales of 1, 0.8 and 0.6. The order is that of the file names,
    whatever the order of the folders. Raises UserError if there is no picture, or a file isn't one.
    """
    files = sorted(
        {
            file
            for folder in folders
            for file in ([folder] if folder.is_file() else folder.rglob("*"))
            if file.suffix.lower() in _SUFFIXES
        },
        key=lambda file: file.name,
    )
    if not files:
        raise UserError(f"{', '.join(map(str, folders))}: no picture to learn from. Name folders.")
    return [_resize(_read(file), scale) for file in files for scale in (1.0, 0.8, 0.6)]


def _read(file: Path) -> Colours:
    # Blue comes first, as it did when the bundled weights were trained: draws stay the same.
    picture = np.asarray(read_screen_colours(file)[::-1] / np.float32(255), dtype=np.float32)
    # A longer side of more than 1100 pixels is averaged down, which sharpens the picture and
    # removes traces of JPEG and demosaicing.
    return _resize(picture, min(1100 / max(picture.shape[1:]), 1.0))


def _resize(picture: Colours, scale: float) -> Colours:
    if scale == 1:
        return np.ascontiguousarray(picture)
    size = [round(n * scale) for n in picture.shape[1:]][::-1]
    return np.stack([cv2.resize(band, size, interpolation=cv2.INTER_AREA) for band in picture])


def grey_patches(
    pictures: Sequence[Colours], count: int, side: int, rng: np.random.Generator
) -> torch.Tensor:
    """Return random grey patches of pictures, (count, 1, side, side).

    They are cut, rotated by multiples of 90 degrees and mirrored at random, and their grey is a
    random mixture of the colours. The probability of a picture is proportional to its area. Raises
    UserError if no picture is larger than a patch.
    """
    areas = np.array([max(p.shape[1] - side, 0) * max(p.shape[2] - side, 0) for p in pictures])
    if not areas.any():
        raise UserError(f"no picture is larger than a patch, {side} x {side} pixels.")
    chosen = rng.choice(len(pictures), count, p=areas / areas.sum())
    return torch.from_numpy(np.stack([_patch(pictures[i], side, rng) for i in chosen]))[:, None]


def _patch(picture: Colours, side: int, rng: np.random.Generator) -> Colours:
    y, x = (int(rng.integers(n - side + 1)) for n in picture.shape[1:])
    mixture = rng.dirichlet(np.ones(3)).astype(np.float32)
    grey = np.tensordot(mixture, picture[:, y : y + side, x : x + side], 1)
    turned = np.rot90(grey, int(rng.integers(4)))
    return np.ascontiguousarray(turned[:, ::-1] if rng.integers(2) else turned)
