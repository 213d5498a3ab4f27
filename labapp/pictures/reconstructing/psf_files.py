"""Read the PSF of a restoration from a picture, an array, or a record with a star."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.files.picture.encoding import LINEAR
from labapp.files.picture.photograph import Light, read_photograph
from labapp.pictures.analysis.psf_place import place_psf
from labapp.pictures.reconstructing.recorded_photograph import (
    RecordSelection,
    is_record,
    read_star_psf,
)


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


def _psf_warnings(path: Path, psf: Light) -> list[str]:
    """Return warnings about a PSF that may be unfit.

    Its edge may be too bright, or the file may be a mere drawing of the PSF in a file beside it.
    """
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
