"""Read and write spectral cubes; the ending of a file's name says its format."""

from __future__ import annotations

from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.cube_paths import ENVI_ENDING, cube_paths
from labapp.files.cubes.cube import SpectralCube
from labapp.files.cubes.envi_cube import encode_envi, read_envi
from labapp.files.cubes.hdf5_cube import encode_hdf5, read_hdf5
from labapp.files.file_lookup import require_readable
from labapp.files.writing import write_atomically


def read_cube(path: Path) -> SpectralCube:
    """Read a spectral cube from an HDF5 or ENVI file.

    Parameters
    ----------
    path : Path
        File ending in .h5, .hdf5, or .hdr: the header of an ENVI file, whose data lies beside it.

    Returns
    -------
    SpectralCube
        The cube, its bands by rising wavelength.

    Raises
    ------
    UserError
        If the file is missing, of another kind, cut short, or its wavelengths have no unit that
        fits.
    """
    require_readable(path)
    cube_paths(path)
    try:
        return read_envi(path) if path.suffix.lower() == ENVI_ENDING else read_hdf5(path)
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
        For another ending.
    """
    files = cube_paths(path)
    parts = (encode_hdf5(cube),) if len(files) == 1 else encode_envi(cube)
    # The header comes last: a header that is there has its data.
    for file, data in reversed(list(zip(files, parts, strict=True))):
        write_atomically(file, data)
    return files
