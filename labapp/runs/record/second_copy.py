"""The copy of all that frames need: where it lies, and which of both is right.

All bytes before the log (table of places, HDF5's structure, texts, columns, chain) stand once more
in the dataset `copy` at the file's end, at least APART bytes further on. So whatever page is lost,
one of both is whole. The last bytes of `copy` tell where it begins, since the table that tells the
places of datasets may be what is lost.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.record import layout
from labapp.runs.record.place_table import Place, PlaceTable, TableError, read_table, write_all

APART = 1 << 20
"""Bytes from anything to its copy, at least: disks lose pages, and whole blocks of them. Chosen."""

_MARK = b"labapp copy\n".ljust(16)
_FOOT = len(_MARK) + 16 + 32

_AT_ONCE = 1 << 20
"""Bytes that are compared at once."""

BETWEEN = "bytes between its datasets"


@dataclass(frozen=True)
class Copy:
    """Where the copy lies in the file.

    begin: first byte of the copy.
    size: number of bytes that stand once more.
    """

    begin: int
    size: int

    def has(self, place: Place) -> bool:
        """Return whether a dataset stands in the copy, too."""
        return place.end <= self.size

    def of(self, place: Place) -> Place:
        """Return where a dataset stands once more."""
        return replace(place, offset=place.offset + self.begin)

    def foot(self) -> bytes:
        """Return the last bytes of the dataset, by which the copy is found."""
        told = self.begin.to_bytes(8, "little") + self.size.to_bytes(8, "little")
        return _MARK + told + sha256(told).digest()


def room_for_copy(front: int, offset: int) -> int:
    """Return the size in bytes of the dataset `copy`.

    front: number of bytes that stand once more.
    offset: bytes from their end to the dataset.
    """
    return max(APART - offset, 0) + front + _FOOT


def find_copy(table: PlaceTable) -> Copy | None:
    """Return where the copy lies by the table of places; None in older formats."""
    place = table.places.get(layout.COPY)
    if place is None:
        return None
    front = min(table.places[name].offset for name in layout.LARGE)
    begin = place.end - _FOOT - front
    if begin < place.offset:
        raise TableError("the table of places has no room for the copy")
    return Copy(begin, front)


def read_either_table(handle: int) -> PlaceTable:
    """Read the table of places, or its copy; raise TableError if neither is whole."""
    try:
        return read_table(handle)
    except TableError:
        size = os.fstat(handle).st_size
        foot = os.pread(handle, _FOOT, max(size - _FOOT, 0))
        begin, front = (int.from_bytes(foot[at : at + 8], "little") for at in (16, 24))
        if foot != Copy(begin, front).foot():
            raise
        return read_table(handle, begin)


def choose_places(handle: int, table: PlaceTable) -> PlaceTable:
    """Return a table with the places of copies for fixed datasets that are whole only there."""
    copy = find_copy(table)
    if copy is None:
        return table
    places = dict(table.places)
    for name, place in table.places.items():
        if place.digest and copy.has(place) and not table.is_whole(handle, name):
            other = PlaceTable(table.size, {name: copy.of(place)})
            if other.is_whole(handle, name):
                places[name] = other.places[name]
    return PlaceTable(table.size, places)


def read_both(handle: int, table: PlaceTable, name: str) -> list[NDArray[Any]]:
    """Read a dataset and its copy: those of both that aren't cut off."""
    return [one.read(handle, name) for one in tables_of_both(handle, table, name)]


def tables_of_both(handle: int, table: PlaceTable, name: str) -> list[PlaceTable]:
    """Return a table of a dataset, and one of its copy, if they aren't cut off."""
    copy, place, size = find_copy(table), table.places.get(name), os.fstat(handle).st_size
    if place is None:
        return []
    both = (place, copy.of(place)) if copy and copy.has(place) else (place,)
    return [PlaceTable(table.size, {name: one}) for one in both if one.end <= size]


def differing_rows(handle: int, table: PlaceTable) -> Iterator[tuple[str, int]]:
    """Yield dataset and row wherever the copy isn't what stands before the log.

    What lies in no dataset is BETWEEN, with its place in the file.
    """
    copy = find_copy(table)
    if copy is None:
        return
    for first, front, second in _blocks(handle, copy):
        at = first + np.flatnonzero(front != second)
        for name, place in table.places.items():
            inside = (at >= place.offset) & (at < place.end)
            if inside.any():
                rows = np.unique((at[inside] - place.offset) // max(place.row_bytes, 1))
                yield from ((name, row) for row in rows.tolist())
                at = at[~inside]
        yield from ((BETWEEN, place) for place in at[:1].tolist())
    place = table.places[layout.COPY]
    head = os.pread(handle, copy.begin - place.offset, place.offset)
    if any(head) or os.pread(handle, _FOOT, place.end - _FOOT) != copy.foot():
        yield layout.COPY, 0


def renew_copy(handle: int, table: PlaceTable, *, is_new: bool = False) -> bool:
    """Write the copy anew from what stands before the log; return whether it differed.

    is_new: whether all of it is written, so that disk space is taken.
    """
    copy = find_copy(table)
    if copy is None:
        return False
    place, differed = table.places[layout.COPY], False
    parts = [(place.offset, bytes(copy.begin - place.offset)), (place.end - _FOOT, copy.foot())]
    for offset, right in parts:
        if os.pread(handle, len(right), offset) != right:
            write_all(handle, memoryview(right), offset)
            differed = True
    for first, front, second in _blocks(handle, copy):
        if is_new or (front != second).any():
            write_all(handle, memoryview(front.tobytes()), copy.begin + first)
            differed = True
    return differed


def _blocks(handle: int, copy: Copy) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8]]]:
    """Yield place, bytes and copied bytes, block by block; zeros for what is cut."""
    for first in range(0, copy.size, _AT_ONCE):
        size = min(_AT_ONCE, copy.size - first)
        front, second = (
            np.frombuffer(os.pread(handle, size, at).ljust(size, b"\0"), np.uint8)
            for at in (first, copy.begin + first)
        )
        yield first, front, second
