"""NumPy's .npy and .npz files, whose sizes are checked before anything is expanded."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from pathlib import Path
from typing import Any, BinaryIO

from numpy.lib import format as npy
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import (
    open_regular,
    read_bytes,
    require_free_memory,
    require_memory,
)

_MOST_MEMBERS = 10_000
"""Arrays in an .npz, about a hundred times more than any of labapp's has. Chosen."""

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Kinds of compression that NumPy writes."""


def read_npy(path: Path) -> NDArray[Any]:
    """Read a .npy array; raise UserError if it isn't one, or is cut short."""
    return _parse_npy(path, read_bytes(path), "")


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of an .npz by name; raise UserError if it is damaged or isn't one."""
    with open_regular(path) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                _require_members(path, archive, file)
                members = {one.filename: archive.read(one) for one in archive.infolist()}
        except (
            zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError, RuntimeError
        ) as error:  # fmt: skip
            raise UserError(
                f"{path}: cannot be read as .npz: {error}. Give a file of numpy.savez."
            ) from error
        return {
            name.removesuffix(".npy"): _parse_npy(path, data, f"{name}: ")
            for name, data in members.items()
        }


def require_plain_zip(path: Path) -> None:
    """Raise UserError if a ZIP archive, such as torch writes, stands for more than it stores.

    Other kinds of files pass.
    """
    with open_regular(path) as file:
        if zipfile.is_zipfile(file):
            try:
                with zipfile.ZipFile(file) as archive:
                    _require_members(path, archive, file)
            except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
                raise UserError(f"{path}: is damaged: {error}. Get the original.") from error


def _require_members(path: Path, archive: zipfile.ZipFile, file: BinaryIO) -> None:
    """Raise UserError if an archive's members are too many, or would grow too large."""
    members = archive.infolist()
    if len(members) > _MOST_MEMBERS:
        raise UserError(f"{path}: holds {len(members)} arrays. Give one with fewer.")
    if any(one.compress_type not in _METHODS for one in members):
        raise UserError(f"{path}: is compressed in another way than NumPy's. Write it anew.")
    stored = file.seek(0, io.SEEK_END)
    require_memory(path, stored, sum(one.file_size for one in members))


def _parse_npy(path: Path, data: bytes, where: str) -> NDArray[Any]:
    """Parse the bytes of a .npy file, or of a member of an .npz."""
    stream = io.BytesIO(data)
    try:
        readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
        read_header = readers[npy.read_magic(stream)]
        shape, _, dtype = read_header(stream)
        if dtype.hasobject:
            raise ValueError("it holds Python objects, which labapp doesn't read")
        wanted, there = math.prod(shape) * dtype.itemsize, len(data) - stream.tell()
        if wanted > there:
            raise ValueError(f"it is cut short: {there} of {wanted} bytes are there")
        require_free_memory(path, wanted, f"{where}its array")
        stream.seek(0)
        found: NDArray[Any] = npy.read_array(stream, allow_pickle=False)
        return found
    except (ValueError, KeyError, TypeError, EOFError, RecursionError, MemoryError) as error:
        reason = "its version is unknown" if isinstance(error, KeyError) else str(error)
        raise UserError(
            f"{path}: {where}cannot be read as a NumPy array: {reason.rstrip('.')}. Give numbers "
            "as numpy.save writes them."
        ) from error
