"""Create datasets, all of them in one piece each, and note what they hold."""

from __future__ import annotations

import errno
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.files.plain_hdf5 import DAMAGE_ERRORS, open_hdf5
from labapp.runs.record.place_table import PlaceTable, rebuild_table

_ROWS_AT_ONCE = 1 << 12
"""Rows that are written at once to a dataset without content: a megabyte. Chosen."""


def write_text(parent: h5py.Group, name: str, text: str | list[str]) -> NDArray[Any]:
    """Write text of fixed length, and return it as it is written.

    HDF5 keeps text of variable length in a heap, and may hang if the heap is damaged.
    """
    encoded = text.encode() if isinstance(text, str) else [one.encode() for one in text]
    kind = h5py.string_dtype("utf-8", np.array(encoded, dtype=bytes).dtype.itemsize)
    values = np.array(encoded, dtype=kind)
    parent.create_dataset(name, data=values)
    return values


def write_empty(dataset: h5py.Dataset) -> None:
    """Write empty rows to a dataset, so that disk space is taken."""
    count = len(dataset)
    empty = np.zeros(min(count, _ROWS_AT_ONCE), dataset.dtype)
    for first in range(0, count, _ROWS_AT_ONCE):
        dataset[first : first + _ROWS_AT_ONCE] = empty[: count - first]


def reserve(
    parent: h5py.Group, name: str, shape: tuple[int, ...], dtype: np.dtype, *, late: bool = False
) -> None:
    """Reserve a fixed place for a contiguous dataset, without disk space.

    late: whether it gets its place only when something is written to it.
    """
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_layout(h5py.h5d.CONTIGUOUS)
    how.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE if late else h5py.h5d.ALLOC_TIME_EARLY)
    how.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    kind = h5py.h5t.py_create(dtype, logical=True)
    h5py.h5d.create(parent.id, name.encode(), kind, h5py.h5s.create_simple(shape), how)


class DraftLedger:
    """Creates the datasets of a new file, and compares what reads back with what was written."""

    def __init__(self) -> None:
        self._digests: dict[str, str] = {}
        self._shapes: dict[str, tuple[int, ...]] = {}
        self._described: dict[str, dict[str, str]] = {}

    def write_text(self, parent: h5py.Group, name: str, text: str | list[str]) -> None:
        """Write text and note it: see the function write_text()."""
        self.note(_path(parent, name), write_text(parent, name, text))

    def allocate(self, parent: h5py.Group, name: str, values: NDArray[Any]) -> None:
        """Write a contiguous dataset, so that disk space is taken, and note it."""
        parent.create_dataset(name, data=values)
        self.note(_path(parent, name), values)

    def reserve(
        self, parent: h5py.Group, name: str, shape: tuple[int, ...], dtype: np.dtype
    ) -> h5py.Dataset:
        """Reserve a place for a dataset that gets it when it is written to."""
        reserve(parent, name, shape, dtype, late=True)
        self._shapes[_path(parent, name)] = shape
        return parent[name]

    def note(self, path: str, values: NDArray[Any]) -> None:
        """Note what was written to a dataset."""
        self._digests[path] = sha256(np.ascontiguousarray(values).tobytes()).hexdigest()
        self._shapes[path] = values.shape

    def note_attributes(self, file: h5py.File) -> None:
        """Note all attributes, when all of them are written."""
        self._described = _attributes(file)

    def read_back(self, path: Path, handle: int) -> PlaceTable:
        """Return the table of places; raise OSError unless all is as written."""
        try:
            table = rebuild_table(path, handle)
            with open_hdf5(path) as file:
                described = _attributes(file)
        except DAMAGE_ERRORS as error:
            raise _not_as_written(str(error)) from error
        if described != self._described:
            raise _not_as_written("attributes")
        if wrong := {n for n, place in table.places.items() if place.shape != self._shapes.get(n)}:
            raise _not_as_written(", ".join(sorted(wrong)))
        if missing := self._shapes.keys() - table.places.keys():
            raise _not_as_written(", ".join(sorted(missing)))
        for name, digest in self._digests.items():
            known = table.places[name].digest
            if (known or sha256(table.read(handle, name).tobytes()).hexdigest()) != digest:
                raise _not_as_written(name)
        if (end := max(place.end for place in table.places.values())) != table.size:
            raise _not_as_written(f"it has {table.size} bytes instead of {end}")
        return table


def _attributes(file: h5py.File) -> dict[str, dict[str, str]]:
    """Return the attributes of all groups and datasets, as texts."""
    found: dict[str, dict[str, str]] = {}

    def collect(name: str, item: Any) -> None:
        found[name] = {key: str(value) for key, value in item.attrs.items()}

    collect("", file)
    file.visititems(collect)
    return found


def _path(parent: h5py.Group, name: str) -> str:
    return f"{parent.name}/{name}".strip("/")


def _not_as_written(what: str) -> OSError:
    return OSError(errno.EIO, f"what was written doesn't read back as it was ({what})")
