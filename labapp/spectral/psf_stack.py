"""PSFs of bands from a file: a cube that knows its wavelengths, or a bare array."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.array_file import read_npy
from labapp.files.cubes import SpectralCube, read_cube
from labapp.files.cubes.hdf5_cube import DEFINITION
from labapp.files.plain_hdf5 import open_plain_hdf5
from labapp.pictures.reconstructing.psf_files import place_psf

Picture = NDArray[np.float64]

_PITCH_TOLERANCE = 0.01
"""Relative difference of two pitches that are taken for the same. A ring that is a hundredth too
large costs less than a tenth of a decibel."""


def is_cube(path: Path) -> bool:
    """Return whether a file is a spectral cube: an ENVI header, or an HDF5 file that says so."""
    if path.suffix.lower() == ".hdr":
        return True
    if path.suffix.lower() not in (".h5", ".hdf5"):
        return False
    try:
        with open_plain_hdf5(path) as file:
            return bool(file["entry/definition"][()] == DEFINITION.encode())
    except UserError:
        return False


def read_psf_stack(path: Path, wavelengths: Sequence[float] | None, pitch: float) -> SpectralCube:
    """Read the PSFs of bands from a file: origin at n // 2, and the sum of each is 1.

    The result's notes say where their light lies, if that isn't plain. Raises UserError if the file
    has other bands, another pitch, or isn't PSFs.

    path: cube (.h5 or .hdr) with its wavelengths, or .npy of (bands, rows, columns) in the order of
        the bands.
    wavelengths: bands in metres, rising; None for all that the file has, which must then be a cube.
    pitch: the sensor's, metres.
    """
    if is_cube(path):
        stack = read_cube(path)
        _require_pitch(path, stack, pitch)
        if wavelengths is not None:
            stack = _select_bands(path, stack, wavelengths)
        values, bands, notes = np.asarray(stack.values, float), stack.wavelengths, stack.notes
        _require_all_values(path, values)
    else:
        values, bands, notes = *_read_array(path, wavelengths), ()
    sums = values.sum((1, 2), keepdims=True, dtype=np.float64)
    if not (sums > 0).all():
        raise UserError(f"{path}: a PSF sums to {sums.min():g}. It must send light somewhere.")
    placed, told = place_psf(path, values / sums)
    return SpectralCube(
        placed.astype(np.float32),
        bands,
        "share of light per pixel",
        pitch=pitch,
        notes=(*notes, *told),
    )


def _require_all_values(path: Path, values: Picture) -> None:
    """Raise UserError if the PSFs lack values."""
    missing = int(np.isnan(values).sum())
    if missing:
        raise UserError(
            f"--psf {path}: {missing} values are missing. Write 0 where there is no light, and "
            "leave out 'data ignore value'."
        )


def _require_pitch(path: Path, stack: SpectralCube, pitch: float) -> None:
    """Raise UserError if the PSFs have other pixels than the sensor (`pitch` in metres)."""
    if stack.pitch is not None and abs(stack.pitch / pitch - 1) > _PITCH_TOLERANCE:
        raise UserError(
            f"{path}: its pixels are {stack.pitch * 1e6:g} µm apart, and those of the sensor "
            f"{pitch * 1e6:g} µm. Give PSFs on the sensor's pixels."
        )


def _select_bands(path: Path, stack: SpectralCube, wavelengths: Sequence[float]) -> SpectralCube:
    try:
        return stack.select_bands(tuple(wavelengths))
    except UserError as error:
        raise UserError(f"--psf {path}: {error}.") from error


def _read_array(
    path: Path, wavelengths: Sequence[float] | None
) -> tuple[Picture, tuple[float, ...]]:
    """Read PSFs from a .npy file; raise UserError if they aren't as many as the bands."""
    if path.suffix.lower() != ".npy":
        raise UserError(
            f"--psf {path}: bands need a PSF each. Give a cube (.h5, .hdr), a record with a star, "
            "or an array (bands, rows, columns) as .npy."
        )
    if wavelengths is None:
        raise UserError(
            f"--psf {path}: an array doesn't say its wavelengths. Name the bands instead of all: "
            "--bands 450,500,550."
        )
    values = read_npy(path)
    if values.dtype.kind not in "iuf" or values.ndim != 3 or not np.isfinite(values).all():
        raise UserError(
            f"--psf {path}: holds {values.dtype} values of shape {values.shape}. Give finite "
            "numbers, (bands, rows, columns)."
        )
    if len(values) != len(wavelengths):
        raise UserError(
            f"--psf {path}: has {len(values)} PSFs, and there are {len(wavelengths)} bands. Give "
            "one for each, the shortest wavelength first."
        )
    return values.astype(np.float64), tuple(wavelengths)
