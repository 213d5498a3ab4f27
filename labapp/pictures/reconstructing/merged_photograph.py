"""Read a bracket as `labapp merge` writes it, to restore its light with its variance map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.photograph import Light
from labapp.files.plain_hdf5 import open_hdf5, open_plain_hdf5
from labapp.pictures.analysis.colour_filters import ColourFilters
from optics.hdr import CLIPPED

_PARTS = ("rate", "variance", "state")
"""Datasets that a merged bracket's file has."""


@dataclass(frozen=True, eq=False)
class MergedPhotograph:
    """Light of a merged bracket to restore.

    light: (bands, rows, columns), electrons per second; NaN where nothing was measured, 0 where all
        exposures were clipped.
    variance: of the light, of the same shape; infinite where nothing was measured.
    clipped: pixels that all exposures clipped, of the same shape.
    filters: colour filters of a bracket of RAW files, whose light has one band; None for others.
    """

    light: Light
    variance: NDArray[np.float32]
    clipped: NDArray[np.bool_]
    filters: ColourFilters | None = None

    @property
    def band_count(self) -> int:
        """Return the number of bands that are restored."""
        return len(self.light) if self.filters is None else self.filters.response.shape[1]

    def bands(self, noise: float | None) -> Light:
        """Return the bands before their restoration."""
        if self.filters is None:
            return self.light
        return self.filters.separate(self.light[0], noise or self.least_noise, self.clipped[0])

    @property
    def least_noise(self) -> float:
        """Return the root mean square of the noise."""
        return float(np.sqrt(self.variance[np.isfinite(self.variance)].mean(dtype=np.float64)))


def is_merged(path: Path) -> bool:
    """Return whether a file is a merged bracket."""
    if path.suffix.lower() not in (".h5", ".hdf5") or not h5py.is_hdf5(path):
        return False
    with open_hdf5(path) as file:
        links = [file.get(name, getlink=True) for name in _PARTS]
    return all(isinstance(link, h5py.HardLink) for link in links)


def read_merged(path: Path, *, is_grey: bool = False) -> MergedPhotograph:
    """Read the light and the variance of a merged bracket.

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
    # Behind filters, what is clipped counts as the least that it can be.
    least = 0 if filters is None else rate
    light = np.where(measured, rate, np.where(clipped, least, np.nan))
    return MergedPhotograph(
        light.astype(np.float32), np.where(measured, variance, np.inf), clipped & ~measured, filters
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
