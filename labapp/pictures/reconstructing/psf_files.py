"""Read the PSF of a restoration from a picture, an array, or a record with a star."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.encoding import LINEAR
from labapp.files.picture.photograph import Light, read_photograph
from labapp.pictures.reconstructing.recorded_photograph import (
    RecordSelection,
    is_record,
    read_star_psf,
)
from optics.inverse.psf_origin import centroid_offset, has_origin_in_corner

_TOLD_OFFSET = 0.45
"""Offset of a PSF's light in pixels from which it's told. Chosen: that of an even PSF whose middle
lies between two pixels is told."""


def read_psf_file(path: Path, bands: int, choice: RecordSelection) -> tuple[Light, list[str]]:
    """Read a PSF for `bands` bands, and remarks for the user.

    The PSF is (1 or bands, rows, columns); the sum of each band is 1. Levels of a picture are taken
    as light unless the file says that they aren't. `choice` selects the star of a record. UserError
    for a file that isn't a PSF.
    """
    if is_record(path):
        psf = read_star_psf(path, choice).astype(np.float32)
        if len(psf) not in (1, bands):
            psf = psf.mean(0, keepdims=True)
        return psf / psf.sum((1, 2), keepdims=True), []
    # Files of PSFs hold light whatever their depth, unless they say that they are for a screen.
    psf = read_photograph(path, unstated=LINEAR).light
    if not np.isfinite(psf).all():
        raise UserError(f"{path}: has NaN or infinite values. Measure or compute the PSF again.")
    if len(psf) > 1 and bands == 1:
        psf = psf.sum(0, keepdims=True)
    if len(psf) not in (1, bands):
        raise UserError(
            f"{path}: has {len(psf)} bands and the picture {bands}. Give one, or {bands}."
        )
    sums = psf.sum((1, 2), keepdims=True, dtype=np.float64)
    if not (sums > 0).all():
        raise UserError(f"{path}: sums to {sums.min():g}. A PSF must send light somewhere.")
    psf, said = place_psf(path, psf)
    return (psf / sums).astype(np.float32), [*said, *_psf_warnings(path, psf)]


def place_psf(path: Path, psf: NDArray[np.floating]) -> tuple[NDArray[np.floating], list[str]]:
    """Return PSFs with their origin at index n // 2, and remarks for the user.

    Wrapped light shows that the origin is in the corner. Otherwise all stays where it is: a
    measured PSF's light needn't lie about its origin.

    psf: (bands, rows, columns); the place is the same in all bands.
    """
    said, whole = [], psf.sum(0, dtype=np.float64)
    if has_origin_in_corner(whole):
        psf, whole = (np.fft.fftshift(one, (-2, -1)) for one in (psf, whole))
        said.append(
            f"{path}: its light wraps round the edges; its origin was taken to be in the corner, "
            "as FFTs have it, and moved to the middle."
        )
    down, along = centroid_offset(torch.from_numpy(whole))
    if max(abs(down), abs(along)) > _TOLD_OFFSET:
        said.append(
            f"{path}: its light lies {_way(down, 'down', 'up')} and {_way(along, 'right', 'left')} "
            "of the middle pixel, index n // 2, where its origin is taken to be; if that is wrong, "
            "the restored picture is only moved by as much the other way."
        )
    return psf, said


def _way(pixels: float, positive: str, negative: str) -> str:
    return f"{abs(pixels):.1f} px {positive if pixels > 0 else negative}"


def _psf_warnings(path: Path, psf: Light) -> list[str]:
    """Warn of a PSF with a bright edge, and of one that may be a drawing of a file beside it."""
    said = []
    edge = np.concatenate([psf[:, 0], psf[:, -1], psf[:, :, 0], psf[:, :, -1]], axis=1)
    level = float(np.median(edge)) / float(psf.max())
    # The edge of a PSF without background is at most 1 % of its peak.
    if min(psf.shape[1:]) > 2 and level > 0.01:
        said.append(
            f"{path}: its edge is at {level:.0%} of its peak: is there a background, or is it cut "
            "off? Either leaves rings."
        )
    beside = [path.with_suffix(ending) for ending in (".npy", ".tiff")]
    if path.suffix.lower() == ".png" and (found := [one for one in beside if one.is_file()]):
        said.append(f"{path}: is it a picture of {found[0].name} in decades? Then give that file.")
    return said
