"""Read a bracket as `labapp merge` writes it, to restore its light with its variance map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from labapp.common.errors import UserError
from labapp.files.plain_hdf5 import open_hdf5, open_plain_hdf5
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.reconstructing.problem import BlurredPicture
from optics.hdr import CLIPPED

_PARTS = ("rate", "variance", "state")
"""Datasets that a merged bracket's file has."""


def is_merged(path: Path) -> bool:
    """Return whether a file is a merged bracket."""
    if path.suffix.lower() not in (".h5", ".hdf5") or not h5py.is_hdf5(path):
        return False
    with open_hdf5(path) as file:
        links = [file.get(name, getlink=True) for name in _PARTS]
    return all(isinstance(link, h5py.HardLink) for link in links)


def read_merged(path: Path, *, is_grey: bool) -> BlurredPicture:
    """Read the light and the variance of a merged bracket.

    Light is NaN where nothing was measured, and 0 where all exposures were clipped; behind colour
    filters, it is then the least that it can be.

    is_grey: whether the scene behind colour filters is taken for one band. Raises UserError for
    parts of different shape, values that can't be a variance, a bracket without a measured pixel,
    and filters that can't be.
    """
    with open_plain_hdf5(path) as file:
        rate, variance, state = (np.asarray(file[name]) for name in _PARTS)
        filters = _filters(path, dict(file["rate"].attrs), is_grey)
    shapes = {one.shape for one in (rate, variance, state)}
    if len(shapes) > 1 or rate.ndim not in (2, 3):
        raise UserError(
            f"{path}: rate is {rate.shape}, variance {variance.shape} and state {state.shape}; all "
            "must be (rows, columns), or (bands, rows, columns). Merge the bracket again."
        )
    if np.isnan(variance).any() or (variance <= 0).any():
        raise UserError(
            f"{path}: variance is NaN or not above 0 at {int((~(variance > 0)).sum())} pixels. "
            "Merge the bracket again."
        )
    rate, variance, state = (one[None] if one.ndim == 2 else one for one in (rate, variance, state))
    measured, clipped = np.isfinite(variance) & np.isfinite(rate), state == CLIPPED
    if not measured.any((1, 2)).all():
        raise UserError(
            f"{path}: a band has no measured pixel; its variance is infinite everywhere. Expose "
            "more briefly or longer, and merge again."
        )
    least = 0 if filters is None else rate
    light = np.where(measured, rate, np.where(clipped, least, np.nan))
    return BlurredPicture(
        light.astype(np.float32),
        clipped & ~measured,
        str(path),
        "electrons per second",
        noise_floor=float(np.sqrt(variance[measured].mean(dtype=np.float64))),
        filters=filters,
        variance=np.where(measured, variance, np.inf),
    )


def _filters(path: Path, told: dict[str, Any], is_grey: bool) -> ColourFilters | None:
    """Return the colour filters that the file tells; None if it has none."""
    if "pattern" not in told:
        return None
    pattern = tuple(str(told["pattern"]).split("/"))
    channels = str(told.get("channels", ""))
    gains, matrix = (
        np.asarray(told.get(name, []), dtype=np.float64)
        for name in ("white_balance", "matrix_to_linear_srgb")
    )
    sound = (
        set("".join(pattern)) == set(channels)
        and len({len(row) for row in pattern}) == 1
        and gains.shape == (len(channels),)
        and matrix.shape == (3, len(channels))
        and bool(np.isfinite(matrix).all() and (gains > 0).all() and np.isfinite(gains).all())
    )
    if not sound:
        raise UserError(
            f"{path}: is the mosaic {told['pattern']} of RAW files, without white balance and "
            "matrix that fit it, so that its colours can't be restored. Convert the files to DNG "
            "with a colour matrix, and merge again."
        )
    return ColourFilters(pattern, channels, gains, None if is_grey else matrix, None, is_grey)
