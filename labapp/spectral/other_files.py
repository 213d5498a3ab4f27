"""PSFs and true bands that are in other files: cubes, bare arrays and other records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.array_file import read_npy
from labapp.files.cubes import SpectralCube, read_cube
from labapp.files.cubes.hdf5_cube import DEFINITION
from labapp.files.plain_hdf5 import open_plain_hdf5
from labapp.files.plan_file import Reconstruction
from labapp.pictures.analysis.brackets import Bracket, merge_all
from labapp.pictures.reconstructing.psf_files import place_psf
from labapp.runs.record.reader import Record
from labapp.spectral.band_psfs import BandPSFs, measure_band_psfs
from labapp.spectral.neutral_stack import find_stack
from labapp.spectral.snapshot import recorded_wavelengths, require_recorded_bands
from optics.progress import Progress

# Relative difference of two pitches that are taken for the same. A ring that is a hundredth too
# large costs less than a tenth of a decibel.
_PITCH_TOLERANCE = 0.01


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
        if stack.pitch is not None and abs(stack.pitch / pitch - 1) > _PITCH_TOLERANCE:
            raise UserError(
                f"{path}: its pixels are {stack.pitch * 1e6:g} µm apart, and those of the sensor "
                f"{pitch * 1e6:g} µm. Give PSFs on the sensor's pixels."
            )
        if wavelengths is not None:
            try:
                stack = stack.select_bands(tuple(wavelengths))
            except UserError as error:
                raise UserError(f"--psf {path}: {error}.") from error
        values, bands, notes = np.asarray(stack.values, float), stack.wavelengths, stack.notes
        if missing := int(np.isnan(values).sum()):
            raise UserError(
                f"--psf {path}: {missing} values are missing. Write 0 where there is no light, and "
                "leave out 'data ignore value'."
            )
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


def measure_psfs_of_record(
    path: Path, roles: Reconstruction, wavelengths: Sequence[float], snapshot: Record
) -> BandPSFs:
    """Measure the PSFs of bands (metres) on the star of another record; the sum of each is 1.

    Star and patterns must have the same names there. Raises UserError if its sensor differs from
    that of `snapshot`, or it lacks a band's star.
    """
    with Record(path) as record:
        one, other = (each.camera.sensor for each in (record, snapshot))
        if one.colour != other.colour or not math.isclose(one.pitch, other.pitch, rel_tol=1e-3):
            raise UserError(
                f"--psf {path}: is of another sensor ({one.model}, {one.pitch * 1e6:g} µm) than "
                f"{snapshot.path} ({other.model}, {other.pitch * 1e6:g} µm). Give a record of the "
                "same camera."
            )
        recorded = recorded_wavelengths(record, roles.star, roles.coded)
        what = f"the star {roles.star!r} with pattern {roles.coded!r}"
        require_recorded_bands(wavelengths, recorded, what, record)
        brackets = merge_all(record, Progress(), {roles.star})
        found = measure_band_psfs(record, brackets, roles, wavelengths)
    return replace(found, light=None).with_unit_sums()


def neutral_stack_of_record(
    record: Record, roles: Reconstruction, wavelengths: Sequence[float], shape: tuple[int, ...]
) -> list[Bracket]:
    """Find the neutral photographs of bands (metres) in another record.

    Raises UserError if a band is missing, or its pictures have another shape than `shape`.
    """
    brackets = merge_all(record, Progress(), {roles.photograph})
    stack = find_stack(brackets, roles.photograph, roles.neutral, wavelengths)
    if not stack:
        raise UserError(
            f"--truth {record.path}: hasn't {roles.photograph!r} with the pattern "
            f"{roles.neutral!r} at all bands. Give the record of a spectral stack, or a cube."
        )
    if stack[0].rate.shape != shape:
        raise UserError(
            f"--truth {record.path}: has pictures of {stack[0].rate.shape}, and the snapshot is "
            f"{shape} (rows, columns). Give a record of the same camera."
        )
    return stack


def read_true_cube(path: Path, wavelengths: tuple[float, ...]) -> SpectralCube:
    """Read the wanted bands (metres) of a true cube from a file.

    Raises UserError if the file lacks a band.
    """
    cube = read_cube(path)
    try:
        found = cube.select_bands(wavelengths)
    except UserError as error:
        raise UserError(f"--truth {path}: {str(error).removesuffix('.')}.") from error
    missing = int(found.missing.sum())
    left_out = f"{path.name}: {missing} pixels lack a value in a band, and are left out"
    return replace(found, notes=(*found.notes, left_out)) if missing else found


def _read_array(
    path: Path, wavelengths: Sequence[float] | None
) -> tuple[NDArray[np.float64], tuple[float, ...]]:
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
