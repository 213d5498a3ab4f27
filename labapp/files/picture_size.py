"""Find the size of a picture in its file's header, without decoding it."""

from __future__ import annotations

import io
import struct

PICTURES = "a JPEG, PNG, TIFF, BMP or WebP"
"""Formats of pictures that labapp reads, in words."""

Size = tuple[int, int]

_JPEG = b"\xff\xd8\xff"
_PNG = b"\x89PNG\r\n\x1a\n"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""First bytes of TIFF (Adobe, TIFF 6.0, section 2) and of BigTIFF, in both orders of bytes."""

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers of a frame header, which has the size (ITU-T T.81, table B.1)."""

_ALONE = frozenset({0x01, *range(0xD0, 0xDA)})
"""JPEG's markers without a length after them."""


def is_jpeg(data: bytes) -> bool:
    """Return whether the bytes of a picture file begin as JPEG does."""
    return data.startswith(_JPEG)


def is_tiff(data: bytes) -> bool:
    """Return whether the bytes of a picture file begin as TIFF does."""
    return data.startswith(_TIFF)


def picture_size(data: bytes, page: int = 0) -> Size | None:
    """Return width and height of the picture in a file's bytes; None if it is no such picture.

    `page` selects a picture of a TIFF file. Other formats than JPEG, PNG, TIFF, BMP and WebP are no
    pictures for labapp.
    """
    try:
        if is_tiff(data):
            return _tiff_size(data, page)
        if data.startswith(_PNG):
            return _unpack(">II", data, 16)
        if is_jpeg(data):
            return _jpeg_size(data)
        if data.startswith(b"BM"):
            return _bmp_size(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp_size(data)
    except (struct.error, IndexError):
        pass
    return None


def count_pages(data: bytes) -> int:
    """Return how many pictures the bytes of a file hold: several can be only in TIFF."""
    import tifffile

    if not is_tiff(data):
        return 1
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            return len(file.pages)
    except Exception:
        return 1


def _unpack(form: str, data: bytes, at: int) -> Size:
    first, second = struct.unpack_from(form, data, at)
    return first, second


def _jpeg_size(data: bytes) -> Size | None:
    """Return the size in the frame header of a JPEG file (ITU-T T.81, section B.2.2)."""
    at = 2
    while (at := data.find(b"\xff", at)) >= 0:
        while data[at] == 0xFF:
            at += 1
        marker = data[at]
        if marker in _FRAMES:
            height, width = _unpack(">HH", data, at + 4)
            return width, height
        at += 1 if marker in _ALONE else 1 + int.from_bytes(data[at + 1 : at + 3], "big")
    return None


def _bmp_size(data: bytes) -> Size:
    """Return the size of a Windows bitmap; rows from top to bottom have a negative height."""
    (header,) = struct.unpack_from("<I", data, 14)
    width, height = _unpack("<HH" if header == 12 else "<ii", data, 18)
    return width, abs(height)


def _webp_size(data: bytes) -> Size | None:
    """Return the size in the first chunk of a WebP file (RFC 9649, section 2)."""
    kind = data[12:16]
    if kind == b"VP8 ":
        width, height = _unpack("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") for at in (24, 27))
        return width + 1, height + 1
    return None


def _tiff_size(data: bytes, page: int) -> Size | None:
    """Return the size of a page of a TIFF file; of tiles, where they are larger."""
    import tifffile

    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            found = file.pages[page].keyframe
            if found is None:
                return None
            width = max(found.imagewidth, found.tilewidth)
            return int(width), int(max(found.imagelength, found.tilelength))
    # A damaged file makes tifffile raise whatever its numbers lead to.
    except Exception:
        return None
