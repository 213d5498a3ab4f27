"""The files of a spectral cube, by the ending of its name. The module loads nothing slow."""

from __future__ import annotations

from pathlib import Path

from labapp.common.errors import UserError

HDF5_ENDINGS = (".h5", ".hdf5")
ENVI_ENDING = ".hdr"
ENVI_DATA_ENDING = ".raw"


def cube_paths(path: Path) -> tuple[Path, ...]:
    """Return the paths that hold a cube: one of HDF5, or a header and the data of ENVI.

    The ending, .h5, .hdf5 or .hdr, chooses the format; UserError for another.
    """
    ending = path.suffix.lower()
    if ending in HDF5_ENDINGS:
        return (path,)
    if ending == ENVI_ENDING:
        return path, path.with_suffix(ENVI_DATA_ENDING)
    raise UserError(
        f"{path}: the ending says the kind of a cube; name it .h5 (HDF5, with all that is known), "
        "or .hdr (ENVI, with a .raw beside it)."
    )
