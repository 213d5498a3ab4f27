"""TIFF files written byte by byte from TIFF 6.0 and its technical notes, every layout that mixes.

Only the compression of a segment comes from a library (imagecodecs, zlib, lzma); it is another
library's encoder where the reader under test may use the decoder of the same.
"""

from __future__ import annotations

import lzma
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray

Samples = NDArray[Any]
"""(rows, columns, samples of a pixel), as stored."""

Tag = tuple[int, Any]
"""TIFF's type (3 SHORT, 4 LONG, 2 ASCII, 5 RATIONAL, 7 UNDEFINED, ...) and values."""

NONE, LZW, JPEG, DEFLATE, PACKBITS, OLD_DEFLATE = 1, 5, 7, 8, 32773, 32946
LERC, JPEG_2000, LZMA, PNG, JPEG_XR = 34887, 34712, 34925, 34933, 34934
ZSTD, WEBP, JPEG_XL, THUNDERSCAN = 50000, 50001, 50002, 32809

UNSIGNED, SIGNED, FLOAT = 1, 2, 3

_FORMATS = {1: "B", 3: "H", 4: "I", 6: "b", 8: "h", 9: "i", 11: "f", 12: "d", 13: "I", 16: "Q"}


@dataclass(frozen=True)
class Layout:
    """How a page is stored. tile: (rows, columns); strip: rows, None for all in one."""

    bits: int = 8
    form: int = UNSIGNED
    photometric: int = 1
    separate: bool = False
    strip: int | None = None
    tile: tuple[int, int] | None = None
    compression: int = NONE
    predictor: int = 1
    reverse_bits: bool = False
    extra: tuple[int, ...] = ()
    subsampling: tuple[int, int] = (1, 1)
    tags: dict[int, Tag] = field(default_factory=dict)


@dataclass
class Page:
    """Tags of a page and its segments, not yet placed. below: pages that it points to (330)."""

    tags: dict[int, Tag]
    segments: list[bytes]
    tiled: bool
    below: list[Page] = field(default_factory=list)


def tiff_page(samples: Samples, layout: Layout, order: str = "<") -> Page:
    """A page of samples under a layout, in a byte order."""
    if samples.ndim == 2:
        samples = samples[..., None]
    rows, columns, count = samples.shape
    parts = np.split(samples, count, axis=-1) if layout.separate else [samples]
    segments = [_encoded(piece, layout, order) for part in parts for piece in _pieces(part, layout)]
    tags: dict[int, Tag] = {
        256: (4, [columns]),
        257: (4, [rows]),
        258: (3, [layout.bits] * count),
        259: (3, [layout.compression]),
        262: (3, [layout.photometric]),
        277: (3, [count]),
        284: (3, [2 if layout.separate else 1]),
        339: (3, [layout.form] * count),
    }
    if layout.tile:
        tags |= {322: (4, [layout.tile[1]]), 323: (4, [layout.tile[0]])}
    else:
        tags[278] = (4, [layout.strip or rows])
    if layout.predictor != 1:
        tags[317] = (3, [layout.predictor])
    if layout.reverse_bits:
        tags[266] = (3, [2])
    if layout.extra:
        tags[338] = (3, list(layout.extra))
    if layout.photometric == 6:
        tags[530] = (3, list(layout.subsampling))
    return Page(tags | layout.tags, segments, layout.tile is not None)


def _pieces(part: Samples, layout: Layout) -> list[Samples]:
    """Tiles, the last ones padded with what isn't the picture's, or strips."""
    rows, columns, count = part.shape
    if not layout.tile:
        step = layout.strip or rows
        return [part[i : i + step] for i in range(0, rows, step)]
    high, wide = layout.tile
    padded = np.full((-(-rows // high) * high, -(-columns // wide) * wide, count), part[0, 0, 0])
    padded = padded.astype(part.dtype)
    padded[:rows, :columns] = part
    return [
        padded[i : i + high, j : j + wide]
        for i in range(0, padded.shape[0], high)
        for j in range(0, padded.shape[1], wide)
    ]


def _encoded(piece: Samples, layout: Layout, order: str) -> bytes:
    """A strip or tile in the bytes of the file."""
    kind = layout.compression
    if kind in _PICTURE_ENCODERS:
        plain = np.ascontiguousarray(piece[..., 0] if piece.shape[-1] == 1 else piece)
        return _PICTURE_ENCODERS[kind](plain)
    lines = _lines(piece, layout, order)
    if kind == PACKBITS:
        data = b"".join(imagecodecs.packbits_encode(line) for line in lines)
    else:
        data = _BYTE_ENCODERS[kind](b"".join(lines))
    if layout.reverse_bits:
        data = data.translate(_REVERSED)
    return data


def _lines(piece: Samples, layout: Layout, order: str) -> list[bytes]:
    """The rows' bytes before compression."""
    if layout.photometric == 6 and layout.subsampling != (1, 1):
        return _subsampled(piece, layout.subsampling)
    rows, columns, count = piece.shape
    flat = piece.reshape(rows, columns * count)
    if layout.bits % 8 or layout.bits == 24:
        return _packed(flat, layout.bits)
    if layout.predictor == 3:
        return _float_differences(flat, count)
    if layout.predictor == 2:
        bare = flat.view(f"u{flat.itemsize}").reshape(rows, columns, count)
        flat = np.diff(bare, axis=1, prepend=np.zeros_like(bare[:, :1])).reshape(rows, -1)
    return [line.tobytes() for line in flat.astype(flat.dtype.newbyteorder(order))]


def _packed(flat: Samples, bits: int) -> list[bytes]:
    """Bits from the highest on, every row begun at a byte."""
    values = flat.astype(np.uint64)
    shifts = np.arange(bits - 1, -1, -1, dtype=np.uint64)
    ones = ((values[..., None] >> shifts) & np.uint64(1)).astype(np.uint8)
    return [line.tobytes() for line in np.packbits(ones.reshape(len(flat), -1), axis=1)]


def _float_differences(flat: Samples, count: int) -> list[bytes]:
    """Adobe's technical note 3: bytes of equal weight together, highest first, differences."""
    swapped = np.ascontiguousarray(flat.astype(flat.dtype.newbyteorder(">")))
    octets = swapped.view(np.uint8).reshape(len(flat), flat.shape[1], flat.itemsize)
    planes = octets.transpose(0, 2, 1).reshape(len(flat), -1)
    before = np.zeros_like(planes)
    before[:, count:] = planes[:, :-count]
    return [line.tobytes() for line in planes - before]


def _subsampled(piece: Samples, by: tuple[int, int]) -> list[bytes]:
    """Data units of YCbCr: the block's Y, then the mean Cb and Cr."""
    wide, high = by
    rows, columns, _ = piece.shape
    padding = ((0, -rows % high), (0, -columns % wide), (0, 0))
    full = np.pad(piece, padding, "edge").astype(np.uint16)
    blocks = full.reshape(full.shape[0] // high, high, full.shape[1] // wide, wide, 3)
    blocks = blocks.transpose(0, 2, 1, 3, 4).reshape(*blocks.shape[::2][:2], high * wide, 3)
    luma = blocks[..., 0]
    chroma = np.rint(blocks[..., 1:].mean(axis=2))
    return [line.tobytes() for line in np.concatenate([luma, chroma], -1).astype(np.uint8)]


def thunderscan(levels: NDArray[np.uint8]) -> bytes:
    """4-bit grey in raw codes and runs of Thunderscan."""
    out = bytearray()
    for row in levels:
        previous, at = 0, 0
        while at < len(row):
            run = 0
            while at + run < len(row) and row[at + run] == previous and run < 63:
                run += 1
            if run:
                out.append(run)
                at += run
                continue
            previous = int(row[at])
            out.append(0xC0 | previous)
            at += 1
    return bytes(out)


def tiff_file(pages: Sequence[Page], order: str = "<", big: bool = False) -> bytes:
    """Pages one after the other, each before its tables."""
    out = bytearray(b"II" if order == "<" else b"MM")
    out += struct.pack(order + ("HHHQ" if big else "HI"), *((43, 8, 0, 0) if big else (42, 0)))
    link = len(out) - (8 if big else 4)
    for page in pages:
        link = _append(out, page, order, big, link)
    return bytes(out)


def _append(out: bytearray, page: Page, order: str, big: bool, link: int) -> int:
    """Add a page, have the table before point to it, and say where the next one is linked."""
    word, pointer = (16, "Q") if big else (4, "I")
    places = []
    for segment in page.segments:
        out += b"\0" * (len(out) % 2)
        places.append(len(out))
        out += segment
    tags = dict(page.tags)
    at, sizes = (324, 325) if page.tiled else (273, 279)
    tags.setdefault(at, (word, places))
    tags.setdefault(sizes, (word, [len(segment) for segment in page.segments]))
    if page.below:
        tags[330] = (word, [_lone(out, one, order, big) for one in page.below])
    entries = [_entry(out, tag, *value, order, big) for tag, value in sorted(tags.items()) if value]
    out += b"\0" * (len(out) % 2)
    struct.pack_into(order + pointer, out, link, len(out))
    out += struct.pack(order + ("Q" if big else "H"), len(entries)) + b"".join(entries)
    out += bytes(8 if big else 4)
    return len(out) - (8 if big else 4)


def _lone(out: bytearray, page: Page, order: str, big: bool) -> int:
    """A page outside the chain: where its table begins."""
    hole = len(out)
    out += bytes(8)
    _append(out, page, order, big, hole)
    return struct.unpack_from(order + ("Q" if big else "I"), out, hole)[0]


def _entry(out: bytearray, tag: int, kind: int, values: Any, order: str, big: bool) -> bytes:
    """A tag's 12 or 20 bytes; what doesn't fit is written before."""
    data, count = _value_bytes(kind, values, order)
    room = 8 if big else 4
    if len(data) > room:
        out += b"\0" * (len(out) % 2)
        place = len(out)
        out += data
        data = struct.pack(order + ("Q" if big else "I"), place)
    head = struct.pack(order + "HH" + ("Q" if big else "I"), tag, kind, count)
    return head + data.ljust(room, b"\0")


def _value_bytes(kind: int, values: Any, order: str) -> tuple[bytes, int]:
    if isinstance(values, str):
        values = values.encode() + b"\0"
    if isinstance(values, bytes):
        return values, len(values)
    if kind in (5, 10):
        flat = [number for pair in values for number in pair]
        return struct.pack(f"{order}{len(flat)}{'I' if kind == 5 else 'i'}", *flat), len(values)
    return struct.pack(f"{order}{len(values)}{_FORMATS[kind]}", *values), len(values)


_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))

_BYTE_ENCODERS: dict[int, Any] = {
    NONE: bytes,
    LZW: imagecodecs.lzw_encode,
    DEFLATE: zlib.compress,
    OLD_DEFLATE: zlib.compress,
    LZMA: lambda data: lzma.compress(data, format=lzma.FORMAT_XZ),
    ZSTD: imagecodecs.zstd_encode,
}

_PICTURE_ENCODERS: dict[int, Any] = {
    LERC: imagecodecs.lerc_encode,
    JPEG_2000: lambda a: imagecodecs.jpeg2k_encode(a, codecformat="j2k", reversible=True, level=0),
    PNG: imagecodecs.png_encode,
    JPEG_XR: lambda a: imagecodecs.jpegxr_encode(a, level=1.0),
    WEBP: lambda a: imagecodecs.webp_encode(a, lossless=True),
    JPEG_XL: lambda a: imagecodecs.jpegxl_encode(a, lossless=True),
    THUNDERSCAN: thunderscan,
}
