"""The table of places: where each dataset lies in the file, told without HDF5.

It stands in the file's user block, before HDF5's own beginning: a mark, the length of the table,
its SHA-256, and the table as JSON, padded with zeros. So frames can be read from a file whose HDF5
structure is damaged or cut off, and each dataset that never changes can be told to be whole.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.files.hdf5_output import write_all as write_all
from labapp.files.plain_hdf5 import open_hdf5
from labapp.runs.record import layout

USER_BLOCK = 1 << 15
"""Bytes before HDF5's beginning; a power of two, as HDF5 asks for. A table takes about 8 kB."""

_MARK = b"labapp record 3\n"
"""Since format 3, in which it was new."""

_HEAD = len(_MARK) + 8 + 32


class TableError(Exception):
    """A file doesn't begin with a whole table of places."""


@dataclass(frozen=True)
class Place:
    """Where a dataset lies in the file.

    offset: from the file's beginning, bytes.
    digest: SHA-256 of its bytes in hexadecimal; empty for a dataset that changes.
    """

    offset: int
    shape: tuple[int, ...]
    dtype: np.dtype
    digest: str = ""

    @cached_property
    def row_bytes(self) -> int:
        return math.prod(self.shape[1:]) * self.dtype.itemsize

    @property
    def size(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def end(self) -> int:
        return self.offset + self.size


@dataclass(frozen=True)
class PlaceTable:
    """Where all datasets lie.

    size: of the file, bytes.
    places: by path.
    """

    size: int
    places: Mapping[str, Place]

    def read(self, handle: int, name: str) -> NDArray[Any]:
        """Read a dataset; raise TableError if the file ends before it does."""
        place = self.places[name]
        data = os.pread(handle, place.size, place.offset)
        if len(data) < place.size:
            raise TableError(f"{name} is cut off")
        return np.frombuffer(data, place.dtype).reshape(place.shape)

    def read_blocks(self, handle: int, name: str, at_once: int) -> Iterator[NDArray[Any]]:
        """Yield the rows of a dataset in blocks; raise TableError as read() does."""
        place = self.places[name]
        for first in range(0, place.shape[0], at_once):
            rows = min(at_once, place.shape[0] - first)
            size = rows * place.row_bytes
            data = os.pread(handle, size, place.offset + first * place.row_bytes)
            if len(data) < size:
                raise TableError(f"{name} is cut off")
            yield np.frombuffer(data, place.dtype).reshape(rows, *place.shape[1:])

    def write(self, handle: int, name: str, data: bytes, row: int = 0) -> None:
        """Write bytes to a dataset, from one of its rows on."""
        place = self.places[name]
        write_all(handle, memoryview(data), place.offset + row * place.row_bytes)

    def is_whole(self, handle: int, name: str) -> bool:
        """Return whether a dataset that never changes is as it was when it was made."""
        place = self.places[name]
        data = os.pread(handle, place.size, place.offset)
        return sha256(data).hexdigest() == place.digest


def find_places(file: h5py.File, size: int) -> PlaceTable:
    """Return the table of an open HDF5 file of `size` bytes, without digests."""
    found: dict[str, Place] = {}

    def collect(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            offset = item.id.get_offset()
            if offset is None and item.size:
                raise ValueError(f"{name} doesn't lie within the file in one piece")
            # h5py notes more in a type, such as the encoding of texts.
            found[name] = Place(offset or 0, item.shape or (), _type(_type_name(item.dtype)))

    file.visititems(collect)
    return PlaceTable(size, found)


def rebuild_table(path: Path, handle: int) -> PlaceTable:
    """Return the table of places by what HDF5 and the file's bytes tell now.

    Raises OSError, RuntimeError, ValueError or KeyError if HDF5 can't read the file.
    """
    with open_hdf5(path) as file:
        table = find_places(file, path.stat().st_size)
    places = {
        name: place
        if name in layout.CHANGING
        else replace(place, digest=sha256(table.read(handle, name).tobytes()).hexdigest())
        for name, place in table.places.items()
    }
    return PlaceTable(table.size, places)


def encode(table: PlaceTable) -> bytes:
    """Return the bytes of the user block."""
    rows = {
        name: [place.offset, list(place.shape), _type_name(place.dtype), place.digest]
        for name, place in table.places.items()
    }
    text = json.dumps({"size": table.size, "datasets": rows}).encode()
    whole = _MARK + len(text).to_bytes(8, "little") + sha256(text).digest() + text
    if len(whole) > USER_BLOCK:
        raise ValueError(f"the table of places has {len(whole)} bytes, more than {USER_BLOCK}")
    return whole.ljust(USER_BLOCK, b"\0")


def read_table(handle: int, offset: int = 0) -> PlaceTable:
    """Read the table at its place in an open file; raise TableError if it isn't whole."""
    block = os.pread(handle, USER_BLOCK, offset)
    length = int.from_bytes(block[len(_MARK) : len(_MARK) + 8], "little")
    text = block[_HEAD : _HEAD + length]
    known = block[_HEAD - 32 : _HEAD]
    if not block.startswith(_MARK) or len(text) != length or sha256(text).digest() != known:
        raise TableError("the table of places at the file's beginning is missing or damaged")
    try:
        data, places = json.loads(text), {}
        for name, (begin, shape, kind, digest) in data["datasets"].items():
            place = Place(int(begin), tuple(int(n) for n in shape), _type(kind), str(digest))
            if min(place.offset, *place.shape, 0) < 0 or place.end > data["size"]:
                raise ValueError(f"{name} doesn't lie within the file")
            places[name] = place
        return PlaceTable(int(data["size"]), places)
    except (ValueError, TypeError, KeyError) as error:
        raise TableError(f"the table of places can't be read: {error}") from error


def _type_name(dtype: np.dtype) -> Any:
    """Return the name of a type in the table: text, or (name, type, shape) of each field."""
    if dtype.names is None:
        return dtype.str
    fields = [(name, dtype[name]) for name in dtype.names]
    return [[name, field.base.str, list(field.shape)] for name, field in fields]


def _type(name: Any) -> np.dtype:
    if isinstance(name, str):
        return np.dtype(name)
    return np.dtype([(field, kind, tuple(shape)) for field, kind, shape in name])
