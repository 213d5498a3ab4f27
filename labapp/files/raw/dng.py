"""The mosaic of a DNG as its tags say, held against LibRaw's answer.

LibRaw and tifffile decode the same parts of the file. The tags decide on levels, pattern and area:
LibRaw exchanges black levels where the active area begins at an odd row or column.

Lossless JPEG has no sum by which its decoder finds damage; a second decoder that reads the same
numbers is the evidence. Of whole pictures LibRaw leaves strips undecoded, and mixes up tiles where
two make up a row, so that each part is checked alone.
"""

from __future__ import annotations

import io
import logging
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.exif import Exif, read_exif
from labapp.files.guarded_reading import require_memory
from labapp.files.raw import dng_levels as levels
from labapp.files.raw.dng_page import BITS, LOSSLESS, find_raw_page, page_shape
from labapp.files.raw.libraw import LibRawPicture, decode_by_libraw, require_undamaged
from labapp.files.raw.photograph import RawPhotograph, order_channels
from labapp.files.raw.recognition import COMPRESSION, MAKE
from labapp.files.tiff_directories import Directory

_MODEL, _ORIENTATION, _CROP_ORIGIN, _CROP_SIZE, _SCALE = 272, 274, 50719, 50720, 50718
_OPCODES = (51008, 51009, 51022)
"""Tags of lists of corrections that a converter is to apply."""

_JPEG = 7
"""Value of Compression for JPEG, here the lossless one."""

# What tifffile has to say of a damaged file comes back as an error or a note, not on the terminal.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


def read_dng(path: Path, data: bytes, pages: Sequence[Directory]) -> RawPhotograph:
    """Read a DNG's photograph; UserError names what the file is unless it holds a mosaic."""
    page, first = find_raw_page(path, pages), pages[0]
    rows, columns = page_shape(page)
    require_memory(path, len(data), 2 * rows * columns, "its mosaic")
    pattern = levels.filter_pattern(path, page)
    stored = _decode(path, data, page)
    area = levels.active_area(path, page)
    mosaic = np.ascontiguousarray(stored[area])
    by_rows, by_columns = levels.black_changes(path, page, mosaic.shape)
    orientation = first.number(_ORIENTATION, 1)
    filters = "grey" if pattern is None else "/".join(pattern)
    found = RawPhotograph(
        path,
        f"DNG of {page.number(BITS, 16)} bits, {filters}, {LOSSLESS[page.number(COMPRESSION, 1)]}",
        mosaic,
        pattern,
        levels.black_cell(path, page),
        levels.white_level(page),
        by_rows,
        by_columns,
        None,
        levels.camera_colour(page, first, order_channels(pattern or ())),
        read_exif(data, first.offset) or Exif(),
        orientation if 1 <= orientation <= 8 else 1,
        first.text(MAKE),
        first.text(_MODEL),
        tuple(_remarks(page, mosaic.shape)),
    )
    if not found.dark_levels.max() < found.white:
        raise UserError(
            f"{path}: has a black level of {found.dark_levels.max():g} and a white level of "
            f"{found.white:g}; white must be above black. Convert the camera's file again."
        )
    return found


def _decode(path: Path, data: bytes, page: Directory) -> NDArray[np.uint16]:
    """Decode all numbers by tifffile and by LibRaw, made linear.

    Raises UserError if neither can, or if they differ where one of them must be wrong.
    """
    numbers, other = _decode_by_tags(data, page), decode_by_libraw(path, data)
    if numbers is None:
        if isinstance(other, str) or other.mosaic is None:
            raise _damaged(path, other if isinstance(other, str) else "it has no mosaic")
        require_undamaged(path, other)
        if other.mosaic.shape != page_shape(page):
            raise UserError(
                f"{path}: is a DNG of {' x '.join(map(str, page_shape(page)))} pixels by its tags, "
                f"and {' x '.join(map(str, other.mosaic.shape))} come out of it. Copy it from the "
                "camera again."
            )
        return other.mosaic
    table = levels.linear_table(page)
    own = numbers if table is None else table[np.minimum(numbers, len(table) - 1)]
    seen = other.mosaic if isinstance(other, LibRawPicture) else None
    if seen is not None and np.array_equal(own, seen):
        return own
    # Other kinds have a sum of their own, or nothing that can be misread.
    if page.number(COMPRESSION, 1) == _JPEG:
        damaged = _find_damaged_part(path, page, numbers)
        if damaged is not None:
            raise _damaged(path, f"from row {damaged[0]}, column {damaged[1]} on")
    return own


def _damaged(path: Path, reason: str) -> UserError:
    """Return the error for numbers that can't be trusted."""
    return UserError(
        f"{path}: is a DNG whose picture is damaged ({reason}). Copy it from the camera again, or "
        "convert the camera's file again."
    )


def _decode_by_tags(data: bytes, page: Directory) -> NDArray[np.uint16] | None:
    """Decode a page by tifffile; None if that isn't possible."""
    import tifffile

    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            file.filehandle.seek(page.offset)
            found = np.asarray(tifffile.TiffPage(file, index=0).asarray())
    # A damaged file makes tifffile and its decoders raise whatever its numbers lead to.
    except Exception:
        return None
    if found.dtype.kind != "u" or found.squeeze().shape != page_shape(page):
        return None
    return found.reshape(page_shape(page)).astype(np.uint16)


def _remarks(page: Directory, shape: tuple[int, ...]) -> list[str]:
    """Say what the tags ask of a converter, and isn't done to the mosaic."""
    said = []
    origin, size = page.numbers(_CROP_ORIGIN), page.numbers(_CROP_SIZE)
    if len(origin) == len(size) == 2 and (size[1], size[0]) != shape:
        said.append(
            f"the whole active area of {shape[0]} x {shape[1]} pixels is kept; the file suggests "
            f"{size[1]:g} x {size[0]:g} of them from row {origin[1]:g}, column {origin[0]:g} on"
        )
    scale = page.numbers(_SCALE)
    if len(scale) == 2 and scale[0] != scale[1]:
        said.append(f"pixels aren't square: {scale[1]:g} to {scale[0]:g}; they stay as they are")
    if any(page.has(code) for code in _OPCODES):
        said.append("the file's list of corrections, such as of the lens, is not applied")
    return said


_TILE_WIDTH, _TILE_LENGTH, _ROWS_PER_STRIP = 322, 323, 278

_LEAST_SIDE = 22
"""Pixels along a side below which LibRaw takes no picture."""


def _find_damaged_part(
    path: Path, page: Directory, numbers: NDArray[np.uint16]
) -> tuple[int, int] | None:
    """Return the first pixel of the first part of a mosaic's numbers that LibRaw reads otherwise.

    Parts that are too small for LibRaw aren't checked.
    """
    for (at, size), (top, left, rows, columns) in zip(page.parts, _places(page), strict=False):
        if min(rows, columns) < _LEAST_SIDE:
            continue
        alone = _single_strip(page.data[at : at + size], rows, columns, page.number(BITS, 16))
        found = decode_by_libraw(path, alone)
        seen = numbers[top : top + rows, left : left + columns]
        if (
            isinstance(found, str)
            or found.mosaic is None
            or found.messages
            or not np.array_equal(found.mosaic[: seen.shape[0], : seen.shape[1]], seen)
        ):
            return top, left
    return None


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
    byte, text, short, long = range(1, 5)
    count = 15
    # The numbers of 16 bits, of which each takes the room of 32, have the least byte first.
    entries = [
        (254, long, 1, 0), (256, long, 1, columns), (257, long, 1, rows), (258, short, 1, bits),
        (259, short, 1, 7), (262, short, 1, 32803), (271, text, 2, ord("-")),
        (272, text, 2, ord("-")), (273, long, 1, 8 + 2 + 12 * count + 4), (277, short, 1, 1),
        (278, long, 1, rows), (279, long, 1, len(part)), (33421, short, 2, 2 << 16 | 2),
        (33422, byte, 4, 0x02010100), (50706, byte, 4, 0x0401),
    ]  # fmt: skip
    head = struct.pack("<2sHIH", b"II", 42, 8, count)
    return head + b"".join(struct.pack("<HHII", *one) for one in entries) + bytes(4) + part
