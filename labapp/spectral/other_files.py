"""PSFs and true bands that are in other files: cubes, arrays and other records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube, read_cube
from labapp.files.plan_file import Reconstruction
from labapp.pictures.analysis.brackets import Bracket, merge_all
from labapp.runs.record.reader import Record
from labapp.spectral.band_psfs import BandPSFs, measure_band_psfs
from labapp.spectral.band_selection import recorded_wavelengths, require_recorded_bands
from labapp.spectral.neutral_stack import find_stack
from optics.progress import Progress


def measure_psfs_of_record(
    path: Path, roles: Reconstruction, wavelengths: Sequence[float], snapshot: Record
) -> BandPSFs:
    """Measure the PSFs of bands (metres) on the star of another record.

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
        return measure_band_psfs(record, brackets, roles, wavelengths)


def neutral_stack_of_record(
    record: Record, roles: Reconstruction, wavelengths: Sequence[float], shape: tuple[int, ...]
) -> list[Bracket]:
    """Find the neutral photographs of bands (metres) in another record.

    Raises UserError if a band is missing, or its pictures have another shape than `shape`.
    """
    brackets = merge_all(record, Progress(), {roles.photograph})
    stack = find_stack(brackets, roles.photograph, roles.neutral, wavelengths)
    if stack is None:
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
