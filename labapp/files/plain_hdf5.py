"""HDF5 from outside, opened only if its data lie in the file and don't expand without measure.

A link, external storage or a virtual dataset makes HDF5 open another file when it is read, and a
filter that isn't built in makes it load a library.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import require_memory, require_regular
from labapp.files.write_locks import NO_LOCKS

MOST_OBJECTS = 1000
"""Groups and datasets, about ten times more than any file that labapp writes has. Chosen."""

_LONGEST_NAME = 80
"""Characters of a name that an error tells: a line. Chosen."""

_MOST_CHUNKS = 100_000
"""Chunks of a dataset, for each of which HDF5 keeps some hundred bytes. Chosen."""

_FILTERS = frozenset(
    getattr(h5py.h5z, f"FILTER_{name}")
    for name in ("DEFLATE", "SHUFFLE", "FLETCHER32", "NBIT", "SCALEOFFSET", "LZF")
)
"""Filters that h5py brings along; HDF5 looks for all others in folders of the system."""

_REMEDIES = {
    errno.EACCES: "Ask its owner, or copy it.",
    errno.EPERM: "Ask its owner, or copy it.",
    errno.ENOENT: "Check the path.",
    errno.EIO: "The disk or the network fails: get a copy from elsewhere.",
    errno.ESTALE: "The network share was mounted anew: try again.",
}
"""What to do about errors of the system."""

DAMAGE_ERRORS = (
    OSError, RuntimeError, ValueError, TypeError, AttributeError, LookupError, MemoryError,
)  # fmt: skip
"""What h5py, and decoding what it read, raise for damaged files."""


def open_hdf5(path: Path) -> h5py.File:
    """Open HDF5 for reading, without a lock where its file system keeps none."""
    try:
        return h5py.File(path, "r")
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        return h5py.File(path, "r", locking=False)


def explain_system_error(error: BaseException) -> str | None:
    """Return why the system can't read what h5py opens; None if the file is the cause.

    h5py's errors have the number of the system's error, if there was one.
    """
    if not isinstance(error, OSError) or not error.errno:
        return None
    if error.errno == errno.EAGAIN:
        return "another program has locked it. Close that program, and try again."
    remedy = _REMEDIES.get(error.errno, "Try again; if that fails, copy it to another disk.")
    return f"cannot be read: {os.strerror(error.errno)}. {remedy}"


@contextmanager
def open_plain_hdf5(path: Path) -> Iterator[h5py.File]:
    """Open untrusted HDF5 for reading; a context manager.

    Raises UserError if it is no regular file, isn't HDF5, refers to other files, or would expand
    to much more than it stores; and where the block fails because the file is damaged.
    """
    require_regular(path)
    try:
        with open_hdf5(path) as file:
            for name, dataset in walk_datasets(file, path):
                _require_plain(path, name, dataset)
            yield file
    except OSError as error:
        told = explain_system_error(error) or f"cannot be read as HDF5: {error}. Get the original."
        raise UserError(f"{path}: {told}") from error
    except DAMAGE_ERRORS as error:
        raise UserError(
            f"{path}: is damaged: {error}. Get the original, or make it again."
        ) from error


def read_hdf5_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read all HDF5 arrays by name; UserError if the file is damaged or isn't HDF5."""
    with open_plain_hdf5(path) as file:
        return {name: np.asarray(dataset[()]) for name, dataset in walk_datasets(file, path)}


def walk_datasets(file: h5py.File, path: Path) -> Iterator[tuple[str, h5py.Dataset]]:
    """Yield name and dataset of all that is linked; raise UserError for links to elsewhere."""
    seen, groups = 0, [("", file["/"])]
    while groups:
        prefix, group = groups.pop()
        for link in group.id:
            seen += 1
            name = prefix + link.decode(errors="replace")
            kind = group.id.links.get_info(link).type
            if kind != h5py.h5l.TYPE_HARD or seen > MOST_OBJECTS:
                what = "is a link to elsewhere" if seen <= MOST_OBJECTS else "is one too many"
                raise UserError(
                    f"{path}: {name[:_LONGEST_NAME]} {what}: labapp writes none. Don't "
                    "trust the file; get the original."
                )
            item = group[link]
            if isinstance(item, h5py.Group):
                groups.append((f"{name}/", item))
            elif isinstance(item, h5py.Dataset):
                yield name, item


def _require_plain(path: Path, name: str, dataset: h5py.Dataset) -> None:
    """Raise UserError for a dataset that lies elsewhere or would grow too large."""
    storage = dataset.id.get_create_plist()
    lies_here = storage.get_layout() != h5py.h5d.VIRTUAL and not storage.get_external_count()
    filters = {storage.get_filter(k)[0] for k in range(storage.get_nfilters())}
    if not lies_here or not filters <= _FILTERS:
        where = "another library" if lies_here else "another file"
        raise UserError(
            f"{path}: {name} can be read only with {where}. Copy the data into one file of their "
            "own, as h5repack does."
        )
    if has_variable_length(dataset) and dataset.size not in (0, 1):
        raise UserError(f"{path}: {name} is a list of texts or lists. Give arrays of numbers.")
    if dataset.chunks is not None:
        counts = (-(-n // m) for n, m in zip(dataset.shape, dataset.chunks, strict=True))
        if math.prod(counts) > _MOST_CHUNKS:
            raise UserError(f"{path}: {name} lies in too many pieces. Write it anew.")
    require_memory(path, dataset.id.get_storage_size(), memory_size(dataset), name)


def has_variable_length(dataset: h5py.Dataset) -> bool:
    """Return whether each element of a dataset refers to data of any length."""
    return dataset.dtype.hasobject or h5py.check_vlen_dtype(dataset.dtype) is not None


def memory_size(dataset: h5py.Dataset) -> int:
    """Return the bytes that a dataset takes in memory; 0 for one without a shape."""
    return 0 if dataset.size is None else dataset.size * dataset.dtype.itemsize
