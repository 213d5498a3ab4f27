"""The simulated coded snapshot on which restorations of spectral bands are compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.accuracy.option_validation import require_psf_name
from labapp.common.errors import UserError
from labapp.files.cubes import read_cube
from labapp.spectral.computed_snapshot import (
    ComputedSnapshot,
    bundled_mosaic,
    chart_cube,
    compute_snapshot,
)
from labapp.spectral.typical_spectra import typical_reflectances
from optics.multispectral import dot_psfs, linear_dispersion_psfs, ring_psfs, spiral_psfs
from optics.plane import Plane
from optics.targets import ring_positions

_BANDS = tuple(nm * 1e-9 for nm in (450.0, 500.0, 550.0, 600.0, 650.0, 700.0))
"""Bands of the thesis (Fig. 4.3), in metres."""

_RADIUS_SHARE, _LARGEST_RADIUS = 0.08, 20.0
"""Radius of the PSF in the longest band, over the side of the picture, and its limit in pixels;
chosen, so that small pictures are still larger than their PSFs."""

_PEAK = 0.2
"""Share of the light in the middle of a PSF; chosen, as of light that a panel doesn't modulate."""

_DOTS = 8


@dataclass(frozen=True, eq=False)
class SpectralCase:
    """A simulated coded snapshot of a known spectral cube, and its name in words.

    spectra: typical spectra, (samples, bands).
    notes: remarks for the user on how the cube's file was read.
    """

    name: str
    snapshot: ComputedSnapshot
    spectra: torch.Tensor
    notes: tuple[str, ...] = ()


def spectral_case_from_options(
    cube: Path | None, psf: str, noise: float, size: int, seed: int
) -> SpectralCase:
    """Simulate the snapshot that the options of `labapp accuracy multispectral` describe.

    cube: file of a spectral cube in shares of white; None for a ColorChecker in six bands.
    size: largest side in pixels; larger cubes are cut to their middle.
    Raises UserError if the shape is unknown, or the cube can't be restored.
    """
    require_psf_name(psf)
    wavelengths, notes = _BANDS, tuple[str, ...]()
    if cube is None:
        truth = chart_cube(_BANDS, size)
    else:
        read = read_cube(cube)
        wavelengths, notes = read.wavelengths, read.notes
        rows, columns = (
            slice((n - min(n, size)) // 2, (n + min(n, size)) // 2) for n in read.shape[1:]
        )
        truth = np.asarray(read.values[:, rows, columns], dtype=np.float64)
        _require_light(cube, truth)
    radius = min(_LARGEST_RADIUS, _RADIUS_SHARE * min(truth.shape[1:]))
    side = 2 * round(radius + 5) + 1
    plane = Plane((side, side), (1.0, 1.0))
    reach = ring_positions(_DOTS, radius) if psf == "dots" else radius
    psfs = _MAKERS[psf](plane, wavelengths, reach, unmodulated=_PEAK).numpy()
    try:
        snapshot = compute_snapshot(
            truth, psfs, bundled_mosaic(), wavelengths, noise=noise, seed=seed
        )
    except ValueError as error:
        raise UserError(f"{cube or 'the chart'}: {error}.") from error
    scene = "ColorChecker" if cube is None else cube.name
    words = f"{scene}, {psf}, noise {noise:g}, {truth.shape}"
    spectra = torch.from_numpy(typical_reflectances(wavelengths))
    return SpectralCase(words, snapshot, spectra, notes)


_MAKERS: dict[str, Callable[..., torch.Tensor]] = {
    "ring": ring_psfs,
    "spiral": spiral_psfs,
    "dots": dot_psfs,
    "linear dispersion": linear_dispersion_psfs,
}


def _require_light(cube: Path, truth: NDArray[np.float64]) -> None:
    """Raise UserError for a cube that isn't finite, is dark, or has few pixels."""
    missing = int(np.isnan(truth).any(0).sum())
    if missing:
        raise UserError(
            f"{cube}: lacks a value at {missing} pixels of its middle, {truth.shape[1:]}. Cut the "
            "cube to where all bands have values, or give a smaller --size."
        )
    if not (np.isfinite(truth).all() and truth.max() > 0):
        raise UserError(f"{cube}: is dark, or not finite. Give a cube with light in it.")
    if min(truth.shape[1:]) < 32:
        raise UserError(f"{cube}: is {truth.shape[1:]}; give 32 pixels or more along each side.")
