"""Read and write spectral cubes; the ending of a file's name says its format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.files.cubes.cube import SpectralCube
from labapp.files.cubes.envi_cube import encode_envi, read_envi
from labapp.files.cubes.hdf5_cube import encode_hdf5, read_hdf5
from labapp.files.guarded_reading import require_free_memory, require_regular
from labapp.files.output_paths import ENVI_ENDING, cube_paths
from labapp.files.writing import write_atomically

_LARGE = 16 << 20
"""Bytes from which on the numbers of a cube stay in its file, 16 MiB. Chosen: below, memory is no
matter."""


def read_cube(path: Path) -> SpectralCube:
    """Read a spectral cube from an HDF5 or ENVI file.

    A cube of more than 16 MiB in single precision stays in its file: `values[:, 10:20]` reads rows
    of all its bands, `values[3]` a band, and `numpy.asarray(values)` all of it, if there is memory
    for it.

    Parameters
    ----------
    path : Path
        File ending in .h5, .hdf5, or .hdr: the header of an ENVI file, whose data lies beside it.

    Returns
    -------
    SpectralCube
        The cube, its bands by rising wavelength. Bands that its file marks as bad are left out,
        and NaN stands for missing values; `notes` tell of both.

    Raises
    ------
    UserError
        If the file is missing, of another kind, cut short, or its wavelengths have no unit that
        fits.
    """
    require_regular(path)
    cube_paths(path)
    try:
        cube = read_envi(path) if path.suffix.lower() == ENVI_ENDING else read_hdf5(path)
        if 4 * cube.values.size > _LARGE:
            return cube
        error_map = None if cube.error is None else np.asarray(cube.error)
        return replace(cube, values=np.asarray(cube.values), error=error_map)
    except UserError as error:
        text = str(error).rstrip(".")
        raise UserError(text + "." if str(path) in text else f"{path}: {text}.") from error


def write_cube(path: Path, cube: SpectralCube) -> tuple[Path, ...]:
    """Write a spectral cube to an HDF5 or ENVI file, replacing what is there.

    Parameters
    ----------
    path : Path
        File ending in .h5, .hdf5 or .hdr.
    cube : SpectralCube
        The cube. An ENVI file doesn't hold its error map.

    Returns
    -------
    tuple of Path
        The files that were written.

    Raises
    ------
    UserError
        For another ending, or if there isn't memory for the cube and its bytes.
    """
    files = cube_paths(path)
    require_free_memory(path, 3 * 4 * cube.values.size, "to write the cube")
    parts = (encode_hdf5(cube),) if len(files) == 1 else encode_envi(cube)
    # The header comes last: a header that is there has its data.
    for file, data in reversed(list(zip(files, parts, strict=True))):
        write_atomically(file, data)
    return files
