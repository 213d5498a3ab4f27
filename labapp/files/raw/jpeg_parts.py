"""The parts of a DNG's lossless JPEG, checked one by one by LibRaw, which decodes one part well.

Lossless JPEG has no sum by which its decoder finds damage; a second decoder that reads the same
numbers is the evidence. Of whole pictures LibRaw leaves strips undecoded, and mixes up tiles where
two make up a row.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.files.raw.dng_page import BITS, page_shape
from labapp.files.raw.libraw import LibRawPicture, decode_by_libraw
from labapp.files.tiff_directories import Directory

_TILE_WIDTH, _TILE_LENGTH, _ROWS_PER_STRIP = 322, 323, 278

_LEAST_SIDE = 22
"""Pixels along a side below which LibRaw takes no picture."""


def find_damaged_parts(
    path: Path, page: Directory, numbers: NDArray[np.uint16]
) -> list[tuple[int, int]]:
    """Return the first pixel of each part of the mosaic that LibRaw reads otherwise.

    numbers: the mosaic as another decoder reads it, (rows, columns).
    Parts that are too small for LibRaw aren't checked.
    """
    damaged = []
    for (at, size), (top, left, rows, columns) in zip(page.parts, _places(page), strict=False):
        if min(rows, columns) < _LEAST_SIDE:
            continue
        alone = _single_strip(page.data[at : at + size], rows, columns, page.number(BITS, 16))
        found = decode_by_libraw(path, alone)
        seen = numbers[top : top + rows, left : left + columns]
        if not _holds(found, seen):
            damaged.append((top, left))
    return damaged


def _holds(found: LibRawPicture | str, seen: NDArray[np.uint16]) -> bool:
    """Return whether LibRaw read a part without fault, and as another decoder did."""
    if isinstance(found, str) or found.mosaic is None or found.messages:
        return False
    return np.array_equal(found.mosaic[: seen.shape[0], : seen.shape[1]], seen)


def _places(page: Directory) -> Iterator[tuple[int, int, int, int]]:
    """Yield the first row and column, and the size, of each part of the mosaic."""
    rows, columns = page_shape(page)
    down = page.number(_TILE_LENGTH, page.number(_ROWS_PER_STRIP, rows))
    along = page.number(_TILE_WIDTH, columns)
    is_tiled = page.number(_TILE_WIDTH, 0) > 0
    for top in range(0, rows, max(down, 1)):
        for left in range(0, columns, max(along, 1)):
            yield top, left, down if is_tiled else min(down, rows - top), along


def _single_strip(part: bytes, rows: int, columns: int, bits: int) -> bytes:
    """Return a DNG whose whole mosaic is one part of lossless JPEG."""
    short, long, byte, text = 3, 4, 1, 2
    number, pair = "<HHIHxx", "<HHIHH"
    names = b"-\0\0\0"
    entries = [
        struct.pack("<HHII", 254, long, 1, 0),
        struct.pack("<HHII", 256, long, 1, columns),
        struct.pack("<HHII", 257, long, 1, rows),
        struct.pack(number, 258, short, 1, bits),
        struct.pack(number, 259, short, 1, 7),
        struct.pack(number, 262, short, 1, 32803),
        struct.pack("<HHI4s", 271, text, 2, names),
        struct.pack("<HHI4s", 272, text, 2, names),
        struct.pack("<HHII", 273, long, 1, 0),
        struct.pack(number, 277, short, 1, 1),
        struct.pack("<HHII", 278, long, 1, rows),
        struct.pack("<HHII", 279, long, 1, len(part)),
        struct.pack(pair, 33421, short, 2, 2, 2),
        struct.pack("<HHI4s", 33422, byte, 4, b"\0\1\1\2"),
        struct.pack("<HHI4s", 50706, byte, 4, b"\1\4\0\0"),
    ]
    start = 8 + 2 + 12 * len(entries) + 4
    entries[8] = struct.pack("<HHII", 273, long, 1, start)
    head = struct.pack("<2sHIH", b"II", 42, 8, len(entries))
    return head + b"".join(entries) + struct.pack("<I", 0) + part
