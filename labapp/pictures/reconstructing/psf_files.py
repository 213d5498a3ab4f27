"""The PSF: from a picture of it, an array, or a record with a star."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.files.photograph_file import Light, read_photograph
from labapp.pictures.reconstructing.recorded_photograph import (
    RecordSelection,
    is_record,
    read_star_psf,
)

_DIM = 0.01
"""Of a PSF's peak: what its edge shows at most, if nothing but the PSF is in the picture."""


def read_psf_file(path: Path, bands: int, choice: RecordSelection) -> tuple[Light, list[str]]:
    """(1 or bands, rows, columns), with a sum of 1 each; and what a person should know of it.

    Levels of a picture are taken for light as they are, and a record's star is chosen as its
    photograph is. UserError for what is no PSF.
    """
    if is_record(path):
        psf = read_star_psf(path, choice)[None].astype(np.float32)
        return psf / psf.sum(), []
    # Whatever the depth: PSFs are written as light, not for a screen.
    psf = read_photograph(path, linear=True).light
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
    return (psf / sums).astype(np.float32), _psf_warnings(path, psf)


def _psf_warnings(path: Path, psf: Light) -> list[str]:
    said = []
    edge = np.concatenate([psf[:, 0], psf[:, -1], psf[:, :, 0], psf[:, :, -1]], axis=1)
    level = float(np.median(edge)) / float(psf.max())
    if min(psf.shape[1:]) > 2 and level > _DIM:
        said.append(
            f"{path}: its edge is at {level:.0%} of its peak: is there a background, or is it cut "
            "off? Either leaves rings."
        )
    beside = [path.with_suffix(ending) for ending in (".npy", ".tiff")]
    if path.suffix.lower() == ".png" and (found := [one for one in beside if one.is_file()]):
        said.append(f"{path}: is it a picture of {found[0].name} in decades? Then give that file.")
    return said
