"""Arrays of numbers from NumPy, MATLAB and HDF5 files, and from grey pictures."""

from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.array_file import read_npy, read_npz
from labapp.files.guarded_reading import (
    FREE_EXPANSION,
    MOST_EXPANSION,
    read_bytes,
    require_free_memory,
    require_regular,
)
from labapp.files.picture.grey_picture import read_grey_picture
from labapp.files.plain_hdf5 import read_hdf5_arrays


def read_numbers(path: Path, variable: str | None = None) -> NDArray[np.float64]:
    """Read an array as float64, of any shape.

    variable: the array's name in a .npz, .mat or .h5 file; it may be left out if there is only one.
    Raises UserError if there is no such file or variable, or if it isn't real numbers.
    """
    require_regular(path)
    kind = path.suffix.lower()
    try:
        arrays = _read_arrays(path, kind)
    except ValueError as error:
        raise UserError(f"{path}: cannot be read as {kind or 'a file'}: {error}.") from error
    listed = ", ".join(arrays) or "nothing"
    if variable is None and len(arrays) != 1:
        raise UserError(f"{path}: holds {listed}; name one: variable.")
    if variable is not None and variable not in arrays:
        raise UserError(f"{path}: has no {variable!r}; it holds {listed}.")
    values = np.asarray(next(iter(arrays.values())) if variable is None else arrays[variable])
    if values.dtype.kind not in "iuf":
        raise UserError(f"{path}: holds {values.dtype} values. Give real numbers.")
    require_free_memory(path, 8 * values.size, "its numbers in double precision")
    return values.astype(np.float64, copy=False)


def _read_arrays(path: Path, kind: str) -> dict[str, NDArray[Any]]:
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


_HDF5_VERSION = 2
"""First number of the version of MATLAB 7.3's files, which are HDF5."""

_HEADER, _TAG = 128, 8
"""Bytes of a MATLAB 5 file's header, and of the tag before each element (MathWorks, "MAT-File
Format")."""

_ORDERS: dict[bytes, Literal["little", "big"]] = {b"IM": "little", b"MI": "big"}
"""Order of the bytes by the end of a MATLAB 5 file's header; older files aren't compressed."""

_COMPRESSED = 15
"""Type of a compressed element in its tag."""

_NUMBERS = {"double", "single", "logical"} | {
    f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)
}
"""MATLAB's classes of numbers; others hold tables, texts and programs."""

_STEP = 1 << 20
"""Bytes that are expanded at once to count them."""


def read_matlab(path: Path) -> dict[str, NDArray[Any]]:
    """Read MATLAB's arrays of numbers by name; raise UserError if the file is damaged.

    Arrays of version 7.3 are turned round: its axes have the opposite order.
    """
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import matfile_version

    data = read_bytes(path)
    # The stubs know of paths only; SciPy takes open files, too.
    stream: Any = io.BytesIO(data)
    try:
        if matfile_version(stream)[0] == _HDF5_VERSION:
            return {name: value.T for name, value in read_hdf5_arrays(path).items()}
        _require_expansion(path, data)
        numbers = [name for name, _, kind in whosmat(stream) if kind in _NUMBERS]
        found = loadmat(stream, variable_names=numbers)
        return {name: found[name] for name in numbers}
    except UserError:
        raise
    # Which exceptions damage leads to isn't documented.
    except Exception as error:
        raise UserError(
            f"{path}: cannot be read as .mat: {error}. Save the array in MATLAB again."
        ) from error


def _require_expansion(path: Path, data: bytes) -> None:
    """Raise UserError if the compressed elements of a MATLAB 5 file stand for much more."""
    order = _ORDERS.get(data[_HEADER - 2 : _HEADER])
    most, at, whole = max(FREE_EXPANSION, MOST_EXPANSION * len(data)), _HEADER, 0
    while order and at + _TAG <= len(data):
        kind, size = (int.from_bytes(data[at + k : at + k + 4], order) for k in (0, 4))
        if kind == _COMPRESSED:
            # How many bytes the element stands for, as far as that is asked.
            machine, rest = zlib.decompressobj(), data[at + _TAG : at + _TAG + size]
            while rest and whole < most and not machine.eof:
                whole += len(machine.decompress(rest, _STEP))
                rest = machine.unconsumed_tail
        if whole >= most:
            raise UserError(
                f"{path}: its {len(data)} bytes stand for {whole / 1e6:.0f} MB and more. No "
                "measurement is so empty; get the original."
            )
        at += _TAG + size
