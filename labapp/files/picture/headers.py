"""Kind, size and bits of a picture by its first bytes, without decoding it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from labapp.files.picture.boxed_formats import STARTS as JPEG_XL
from labapp.files.picture.boxed_formats import read_jpeg_xl_header
from labapp.files.picture.file_parts import jpeg_segments

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers of a frame header, which has the size (ITU-T T.81, table B.1)."""

_FRAME_OF_LS = 0xF7

_LOSSLESS = frozenset({0xC3, 0xC7, 0xCB, 0xCF})
"""Those of them that lose nothing."""


@dataclass(frozen=True)
class Header:
    """Kind (in words) and size in pixels of a picture by its first bytes.

    bits: of each sample. is_lossy: whether the compression loses something. None: not said.
    """

    kind: str
    width: int
    height: int
    bits: int | None = 8
    is_lossy: bool | None = False


def find_header(data: bytes) -> Header | None:
    """Find what a header says; None if the format is none that is decoded here.

    TIFF, RAW, FITS, OpenEXR, Radiance and portable maps have readers of their own.
    """
    for begins, read in _READERS:
        if begins(data):
            try:
                return read(data)
            except (struct.error, IndexError, ValueError):
                return None
    return None


def _png(data: bytes) -> Header:
    width, height, bits = struct.unpack_from(">IIB", data, 16)
    if data[12:16] == b"CgBI":
        return Header("PNG of Apple's kind (CgBI)", width=0, height=0)
    return Header("PNG", width, height, bits)


def _jpeg(data: bytes) -> Header | None:
    """Parse a JPEG's frame header (ITU-T T.81, section B.2.2).

    JPEG-LS has a marker of its own (ITU-T T.87, section C.2.2).
    """
    for marker, content in jpeg_segments(data):
        if marker == _FRAME_OF_LS:
            bits, height, width = struct.unpack_from(">BHH", content)
            return Header("JPEG-LS", width, height, bits, None)
        if marker in _FRAMES:
            bits, height, width = struct.unpack_from(">BHH", content)
            return Header("JPEG", width, height, bits, marker not in _LOSSLESS)
    return None


def _bmp(data: bytes) -> Header:
    """Parse a Windows bitmap's header; rows from top to bottom have a negative height."""
    (header,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if header == 12 else "<ii", data, 18)
    return Header("BMP", abs(width), abs(height))


def _webp(data: bytes) -> Header | None:
    """Parse WebP's first chunk (RFC 9649, section 2)."""
    kind = data[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return Header("WebP", width & 0x3FFF, height & 0x3FFF, is_lossy=True)
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return Header("WebP", (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1)
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") for at in (24, 27))
        return Header("WebP", width + 1, height + 1, is_lossy=b"VP8L" not in data[30:4096])
    return None


def _jpeg_2000(data: bytes) -> Header:
    """Parse the codestream of JPEG 2000 (ITU-T T.800, annex A)."""
    at = data.index(b"\xff\x4f\xff\x51") + 4
    right, bottom, left, top = struct.unpack_from(">IIII", data, at + 4)
    bits = (data[at + 38] & 0x7F) + 1
    coded = data.find(b"\xff\x52", at)
    # The wavelet that loses nothing is number 1; 0 is the one that does.
    lossy = None if coded < 0 else data[coded + 13] == 0
    return Header("JPEG 2000", right - left, bottom - top, bits, lossy)


def _avif(data: bytes) -> Header:
    """Parse the properties of an AVIF (ISO 23008-12, section 6.5)."""
    width, height = struct.unpack_from(">II", data, data.index(b"ispe") + 8)
    depth = data.find(b"pixi")
    return Header("AVIF", width, height, data[depth + 9] if depth > 0 else None, None)


def _jpeg_xr(data: bytes) -> Header:
    """Parse the size in the directory of a JPEG XR (ITU-T T.832, annex A)."""
    (at,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, at)
    size = {}
    for number in range(min(count, 100)):
        tag, kind = struct.unpack_from("<HH", data, at + 2 + 12 * number)
        form = {1: "<B", 3: "<H"}.get(kind, "<I")
        (size[tag],) = struct.unpack_from(form, data, at + 10 + 12 * number)
    if not {0xBC80, 0xBC81} <= size.keys():
        raise ValueError("no size")
    return Header("JPEG XR", size[0xBC80], size[0xBC81], None, None)


def _jpeg_xl(data: bytes) -> Header | None:
    found = read_jpeg_xl_header(data)
    if found is None:
        return None
    return Header("JPEG XL", found.width, found.height, found.bits, None)


def _sized(kind: str, form: str, at: int) -> Callable[[bytes], Header]:
    """Return what reads nothing but a size, which stands at a place of the file."""
    return lambda data: Header(kind, *struct.unpack_from(form, data, at))


def _begins(*starts: bytes) -> Callable[[bytes], bool]:
    return lambda data: data.startswith(starts)


_READERS: tuple[tuple[Callable[[bytes], bool], Callable[[bytes], Header | None]], ...] = (
    (_begins(b"\x89PNG\r\n\x1a\n"), _png),
    (_begins(b"\xff\xd8\xff"), _jpeg),
    (_begins(b"BM"), _bmp),
    (lambda data: data[:4] == b"RIFF" and data[8:12] == b"WEBP", _webp),
    (_begins(b"GIF87a", b"GIF89a"), _sized("GIF", "<HH", 6)),
    (_begins(b"\0\0\0\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51"), _jpeg_2000),
    (_begins(*JPEG_XL), _jpeg_xl),
    (lambda data: data[4:12] in (b"ftypavif", b"ftypavis"), _avif),
    (_begins(b"II\xbc\x01"), _jpeg_xr),
    (_begins(b"qoif"), _sized("QOI", ">II", 4)),
    (_begins(b"\x59\xa6\x6a\x95"), _sized("Sun raster", ">II", 4)),
)
"""How the files of each format begin, and what reads their header."""
