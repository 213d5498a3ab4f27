"""Arrays of numbers from NumPy, MATLAB and HDF5 files, and from grey pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.array_file import read_npy, read_npz
from labapp.files.file_lookup import require_readable
from labapp.files.guarded_reading import require_free_memory
from labapp.files.matlab_file import read_matlab
from labapp.files.picture.grey_picture import read_grey_picture
from labapp.files.plain_hdf5 import read_hdf5_arrays


def read_numbers(path: Path, variable: str | None = None) -> NDArray[np.float64]:
    """Read an array as float64, of any shape.

    variable: the array's name in a .npz, .mat or .h5 file; it may be left out if there is only one.
    Raises UserError if there is no such file or variable, or if it isn't real numbers.
    """
    require_readable(path)
    kind = path.suffix.lower()
    try:
        values = _select_variable(path, _variables(path, kind), variable)
    except ValueError as error:
        raise UserError(f"{path}: cannot be read as {kind or 'a file'}: {error}.") from error
    if values.dtype.kind not in "iuf":
        raise UserError(f"{path}: holds {values.dtype} values. Give real numbers.")
    require_free_memory(path, 8 * values.size, "its numbers in double precision")
    return values.astype(np.float64, copy=False)


def _variables(path: Path, kind: str) -> dict[str, NDArray[Any]]:
    """Read all arrays by name; the ending names the format."""
    if kind == ".npy":
        return {path.stem: read_npy(path)}
    if kind == ".npz":
        return read_npz(path)
    if kind in (".h5", ".hdf5"):
        return read_hdf5_arrays(path)
    if kind == ".mat":
        return read_matlab(path)
    return {path.stem: read_grey_picture(path, "an array of numbers")}


def _select_variable(
    path: Path, variables: dict[str, NDArray[Any]], name: str | None
) -> NDArray[Any]:
    if name is None and len(variables) == 1:
        return np.asarray(next(iter(variables.values())))
    if name is None:
        raise UserError(f"{path}: holds {', '.join(variables) or 'nothing'}; name one: variable.")
    if name not in variables:
        raise UserError(f"{path}: has no {name!r}; it holds {', '.join(variables) or 'nothing'}.")
    return np.asarray(variables[name])
