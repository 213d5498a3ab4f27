"""Read a merged bracket as `labapp merge` writes it, to restore its light with its variance map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.photograph import Light
from labapp.files.plain_hdf5 import open_plain_hdf5
from optics.hdr import CLIPPED

_PARTS = ("rate", "variance", "state")
"""Datasets that a merged bracket's file has."""


@dataclass(frozen=True, eq=False)
class MergedPhotograph:
    """The light of a merged bracket to restore.

    Attributes
    ----------
    light : Light
        (bands, rows, columns), electrons per second; NaN where nothing was measured, 0 where all
        exposures were clipped.
    variance : NDArray
        Of the light, of the same shape; infinite where nothing was measured.
    clipped : NDArray of bool
        Pixels that all exposures clipped, of the same shape.
    """

    light: Light
    variance: NDArray[np.float32]
    clipped: NDArray[np.bool_]

    @property
    def least_noise(self) -> float:
        """Return the root mean square of the merged photograph's noise, before its restoration."""
        return float(np.sqrt(self.variance[np.isfinite(self.variance)].mean(dtype=np.float64)))


def is_merged(path: Path) -> bool:
    """Return whether a file with a picture to restore is a merged bracket."""
    if path.suffix.lower() not in (".h5", ".hdf5") or not h5py.is_hdf5(path):
        return False
    with h5py.File(path) as file:
        links = [file.get(name, getlink=True) for name in _PARTS]
    return all(isinstance(link, h5py.HardLink) for link in links)


def read_merged(path: Path) -> MergedPhotograph:
    """Read a merged bracket's light and variance for restoration.

    Raises UserError for parts of different shape, values that can't be a variance, and a bracket
    without a measured pixel.
    """
    with open_plain_hdf5(path) as file:
        rate, variance, state = (np.asarray(file[name]) for name in _PARTS)
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
    light = np.where(measured, rate, np.where(clipped, 0, np.nan))
    return MergedPhotograph(
        light.astype(np.float32), np.where(measured, variance, np.inf), clipped & ~measured
    )
