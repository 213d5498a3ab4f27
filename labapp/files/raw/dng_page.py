"""The page of a DNG that holds the sensor's mosaic; what is none is refused by name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.raw.recognition import CFA, COMPRESSION, LINEAR_RAW, PHOTOMETRIC
from labapp.files.tiff_directories import SUB_DIRECTORIES, Directory

NEW_SUBFILE_TYPE, SAMPLE_FORMAT, SAMPLES, BITS = 254, 339, 277, 258
"""Tags of TIFF, by their names in its specification."""

LOSSLESS = {
    1: "uncompressed", 5: "LZW", 7: "lossless JPEG", 8: "deflate", 32773: "PackBits",
    32946: "deflate", 34925: "LZMA", 50000: "Zstandard",
}  # fmt: skip
"""Compressions that keep each number, by the value of their tag."""

_LOSSY = {
    9: "VC-5", 34712: "JPEG 2000", 34892: "lossy JPEG", 52546: "JPEG XL",
}  # fmt: skip
"""Compressions that do not, or of which a file doesn't say."""

_INTERLEAVED, _BLOCKS = (50975, 52547), 50974
"""Tags of rows and columns in another order (DNG 1.7), and of pixels stored in blocks."""

_TILE_WIDTH, _TILE_LENGTH = 322, 323

_MOST_BITS = 16

_MOST_PADDING = 1.1
"""Bytes stored over those that are needed. Chosen: less than 14 bits in words of 16 bits."""

_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers of a frame (ITU-T T.81, table B.1)."""

_LOSSLESS_FRAME = 0xC3
"""Marker of a frame of lossless JPEG, in Huffman's code."""

_HOW = (
    "Take the camera's own RAW file, or a DNG that was converted with lossless compression and "
    "without demosaicing."
)


def find_raw_page(path: Path, pages: Sequence[Directory]) -> Directory:
    """Return the page of a DNG that holds the sensor's numbers.

    Raises UserError, which names what the file has instead, if there is none or more than one.
    """
    raw = [page for page in pages if page.number(PHOTOMETRIC, 0) in (CFA, LINEAR_RAW)]
    # Bit 0 marks a picture of reduced size, and 0 the main picture.
    whole = [page for page in raw if not page.number(NEW_SUBFILE_TYPE, 0) & 1]
    main = [page for page in whole if page.number(NEW_SUBFILE_TYPE, 0) == 0] or whole
    if not main:
        for page in pages:
            further = (*page.numbers(SUB_DIRECTORIES), page.next_offset)
            if any(at >= len(page.data) for at in further):
                raise UserError(
                    f"{path}: is a RAW file that is cut: the description of a picture lies beyond "
                    f"its {len(page.data)} bytes. Copy it from the camera again."
                )
        raise UserError(
            f"{path}: is a DNG without RAW numbers: it holds {len(pages)} pictures for screens "
            f"alone. {_HOW}"
        )
    mosaics = [page for page in main if page.number(PHOTOMETRIC, 0) == CFA] or main
    pixels = [math.prod(page_shape(page)) for page in mosaics]
    found = [page for page, size in zip(mosaics, pixels, strict=True) if size == max(pixels)]
    if len(found) > 1:
        raise UserError(
            f"{path}: is a DNG with {len(found)} RAW pictures of equal size, and doesn't say which "
            "is the main one. Save each to a file of its own."
        )
    lost = [code for page in (pages[0], found[0]) for code in page.lost]
    if lost:
        raise UserError(
            f"{path}: is a RAW file that is cut or damaged: the values of its tags "
            f"{', '.join(map(str, lost))} lie beyond its {len(pages[0].data)} bytes. Copy it from "
            "the camera again."
        )
    _require_mosaic(path, found[0])
    return found[0]


def page_shape(page: Directory) -> tuple[int, int]:
    """Return the rows and columns of a page."""
    return page.number(257, 0), page.number(256, 0)


def require_whole(path: Path, page: Directory) -> None:
    """Raise UserError if the file ends before a part of the page's picture."""
    size, parts = len(page.data), page.parts
    missing = sum(at + count > size for at, count in parts)
    if missing:
        raise UserError(
            f"{path}: is a RAW file that is cut: it has {size} bytes, and {missing} of the "
            f"{len(parts)} parts of its picture lie beyond them. Copy it from the camera again."
        )
    if not parts or not all(count for _, count in parts):
        raise UserError(
            f"{path}: is a RAW file without a picture: its parts are empty. Copy it from the "
            "camera again."
        )


def _require_mosaic(path: Path, page: Directory) -> None:
    """Raise UserError if the page holds no mosaic of whole numbers that are kept."""
    samples, bits = page.number(SAMPLES, 1), page.number(BITS, 1)
    if page.number(PHOTOMETRIC, 0) == LINEAR_RAW and samples > 1:
        raise UserError(
            f"{path}: is a linear DNG of {samples} colours a pixel: they were interpolated "
            f"already, and the sensor's mosaic isn't in it. {_HOW} Or save it as a 16-bit TIFF."
        )
    if samples > 1:
        raise UserError(
            f"{path}: is a DNG of {samples} numbers a pixel, and a mosaic has one. {_HOW}"
        )
    if page.number(SAMPLE_FORMAT, 1) != 1:
        kind = "floating-point" if page.number(SAMPLE_FORMAT, 1) == 3 else "signed"
        raise UserError(
            f"{path}: is a DNG of {kind} numbers of {bits} bits, such as programs write that merge "
            f"exposures; a sensor's are whole numbers from 0 on. {_HOW}"
        )
    if not 1 <= bits <= _MOST_BITS:
        raise UserError(f"{path}: is a DNG of {bits} bits a pixel; {_MOST_BITS} are the most.")
    if any(page.number(code, 1) != 1 for code in _INTERLEAVED) or set(page.numbers(_BLOCKS)) - {1}:
        raise UserError(f"{path}: is a DNG whose pixels are stored in another order. {_HOW}")
    require_whole(path, page)
    _require_lossless(path, page)
    _require_size(path, page)


def _require_lossless(path: Path, page: Directory) -> None:
    """Raise UserError if the stored numbers aren't those that the sensor gave."""
    code = page.number(COMPRESSION, 1)
    if code in _LOSSY:
        raise UserError(
            f"{path}: is a DNG compressed by {_LOSSY[code]}, which keeps the sensor's numbers only "
            f"nearly, or needn't keep them. {_HOW}"
        )
    if code not in LOSSLESS:
        raise UserError(f"{path}: is a DNG of unknown compression {code}. {_HOW}")
    if code == 7:
        at, size = page.parts[0]
        frame = _jpeg_frame(page.data[at : at + size])
        if frame is None:
            raise UserError(
                f"{path}: is a DNG whose RAW numbers should be lossless JPEG, and aren't: it is "
                "cut or damaged. Copy it from the camera again."
            )
        if frame != _LOSSLESS_FRAME:
            raise UserError(
                f"{path}: is a DNG compressed by JPEG, which keeps the sensor's numbers only "
                f"nearly. {_HOW}"
            )


def _require_size(path: Path, page: Directory) -> None:
    """Raise UserError if uncompressed numbers take more or less room than stated.

    A few bytes more fill up parts. Numbers of 12 bits in words of 16 bits are such a contradiction.
    """
    if page.number(COMPRESSION, 1) != 1:
        return
    bits, (rows, columns) = page.number(BITS, 1), page_shape(page)
    down, along = page.number(_TILE_LENGTH, 0), page.number(_TILE_WIDTH, 0)
    if down and along:
        rows, columns = -(-rows // down) * down * -(-columns // along), along
    needed, stored = rows * (-(-columns * bits // 8)), sum(size for _, size in page.parts)
    if not needed <= stored < needed * _MOST_PADDING:
        raise UserError(
            f"{path}: is a DNG of {bits} bits a pixel by its tags, which take {needed} bytes, and "
            f"{stored} are stored: it is cut, or its tags are wrong. Convert the camera's file "
            "again."
        )


def _jpeg_frame(data: bytes) -> int | None:
    """Return the marker of a JPEG's frame; None if it has none."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        if data[at + 1] in _JPEG_FRAMES:
            return data[at + 1]
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None
