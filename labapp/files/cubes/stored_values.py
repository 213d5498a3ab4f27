"""The numbers of a cube that stay in its file, of which a window at a time is read.

They are indexed as an array is, and what is indexed is read: `values[3]` is a band, and
`values[:, 10:20, 30:40]` a window of all bands. Whatever else is done with them reads them all.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import open_regular, require_free_memory, require_no_holes

Values = NDArray[np.float32]

MOST_CUBE_BYTES = 1 << 40
"""Bytes of a cube's file that is read by windows, 1 TiB: a day of a spectral camera. Chosen."""

Window = tuple[Sequence[int], range, range]
"""Bands in the order in which they are wanted, and rows and columns, one after the other."""


def file_state(path: Path) -> tuple[int, int]:
    """Return the size of a file, bytes, and when it was written last, nanoseconds.

    Raises UserError if it can't be read, or is all holes.
    """
    with open_regular(path, MOST_CUBE_BYTES) as file:
        found = os.fstat(file.fileno())
        require_no_holes(path, found)
        return found.st_size, found.st_mtime_ns


class StoredValues(NDArrayOperatorsMixin):
    """Float32 numbers that stay on the disk, (bands, rows, columns), and are read where indexed.

    NaN stands for a missing value. Reading raises UserError for infinite numbers, for a file that
    has changed, and for more than there is memory. read_window reads a window from the file.
    """

    dtype = np.dtype(np.float32)
    ndim = 3

    def __init__(
        self, path: Path, shape: tuple[int, int, int], read_window: Callable[[Window], Values]
    ) -> None:
        self.path, self.shape = path, shape
        self._read_window, self._state = read_window, file_state(path)

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return math.prod(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Values]:
        return (self[band] for band in range(len(self)))

    def __getitem__(self, key: Any) -> Any:
        """Read what an index selects: numbers, slices, and for the bands also a list of numbers."""
        keys = _three_keys(key)
        if keys is None:
            return np.asarray(self)[key]
        places = [np.arange(n)[one] for n, one in zip(self.shape, keys, strict=True)]
        if min(one.size for one in places) == 0:
            return np.empty([one.size for one in places if one.ndim], self.dtype)
        rows, columns = (range(one.min(), one.max() + 1) for one in places[1:])
        block = self._read(np.atleast_1d(places[0]).tolist(), rows, columns)
        part = block[:, _within(places[1], rows)][..., _within(places[2], columns)]
        return part[0] if places[0].ndim == 0 else part

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Read all numbers; raise UserError if there isn't memory for them."""
        bands, rows, columns = (range(n) for n in self.shape)
        return self._read(bands, rows, columns).astype(dtype or self.dtype, copy=False)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **more: Any) -> Any:
        plain = (np.asarray(one) if isinstance(one, StoredValues) else one for one in inputs)
        return getattr(ufunc, method)(*plain, **more)

    def __getattr__(self, name: str) -> Any:
        """Return what else an array has, such as its mean, of all numbers."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(np.asarray(self), name)

    def _read(self, bands: Sequence[int], rows: range, columns: range) -> Values:
        """Read a window of the numbers; raise UserError if they can't be a cube's."""
        count = len(bands) * len(rows) * len(columns)
        require_free_memory(self.path, count * self.dtype.itemsize, "its cube")
        if file_state(self.path) != self._state:
            raise UserError(f"{self.path}: has changed since its header was read. Read it again.")
        found = self._read_window((bands, rows, columns))
        bad = sum(int(np.isinf(band).sum()) for band in found)
        if bad:
            raise UserError(
                f"{self.path}: has {bad} infinite numbers of {found.size}, or numbers beyond "
                "single precision. Write finite ones."
            )
        return found


def _within(places: Any, span: range) -> Any:
    """Return the index of places on an axis within the span of it that was read."""
    # A slice copies nothing.
    return slice(None) if places.ndim and np.array_equal(places, span) else places - span.start


def _three_keys(key: Any) -> list[Any] | None:
    """Return the index of each axis; None if windows don't serve."""
    keys = list(key) if isinstance(key, tuple) else [key]
    if sum(one is Ellipsis for one in keys) == 1:
        at = next(k for k, one in enumerate(keys) if one is Ellipsis)
        keys[at : at + 1] = [slice(None)] * (4 - len(keys))
    keys += [slice(None)] * (3 - len(keys))
    if len(keys) != 3 or not all(isinstance(one, slice | int | np.integer) for one in keys[1:]):
        return None
    first = keys[0]
    is_list = isinstance(first, list | range) and all(isinstance(n, int) for n in first)
    return keys if is_list or isinstance(first, slice | int | np.integer) else None
