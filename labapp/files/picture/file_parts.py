"""The parts that picture files are made of: chunks of PNG and RIFF, segments of JPEG, boxes.

Each function yields the names and bytes of parts until the end, or until the file isn't what it
should be. Nothing is copied: the bytes are views. In some of them lies a block of Exif.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import NamedTuple

from labapp.files.exif import Exif, read_exif

PNG = b"\x89PNG\r\n\x1a\n"
"""First bytes of PNG (W3C, PNG third edition, section 5.2)."""

_ALONE = frozenset({0x01, *range(0xD0, 0xD9)})
"""JPEG's markers without a length after them (ITU-T T.81, table B.1)."""

_SCAN, _END = 0xDA, 0xD9

_MOST_PARTS = 100_000
"""Parts of a file that are looked at: a PNG of 4 GB in chunks of 40 kB. Chosen."""

_MOST_EXPANDED = 1 << 24
"""Bytes that a text or profile may be expanded to, 16 MiB. Chosen: ICC profiles with large tables
have some megabytes."""


class PngChunk(NamedTuple):
    """A chunk of a PNG; `is_intact` says whether its check sum is right."""

    name: bytes
    content: memoryview
    is_intact: bool


def png_chunks(data: bytes) -> Iterator[PngChunk]:
    """Yield a PNG's chunks but those of its pixels (IDAT), which are only skipped."""
    view, at = memoryview(data), len(PNG)
    for _ in range(_MOST_PARTS if data.startswith(PNG) else 0):
        size, name = int.from_bytes(view[at : at + 4], "big"), bytes(view[at + 4 : at + 8])
        end = at + 8 + size
        if len(name) < 4 or end + 4 > len(data) or name == b"IEND":
            return
        if name != b"IDAT":
            told = int.from_bytes(view[end : end + 4], "big")
            yield PngChunk(name, view[at + 8 : end], zlib.crc32(view[at + 4 : end]) == told)
        at = end + 4


def riff_chunks(data: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Yield names and bytes of the chunks of RIFF, as WebP is (RFC 9649, section 2.3)."""
    view, at = memoryview(data), 12
    for _ in range(_MOST_PARTS if data[:4] == b"RIFF" else 0):
        size = int.from_bytes(view[at + 4 : at + 8], "little")
        if at + 8 + size > len(data):
            return
        yield bytes(view[at : at + 4]), view[at + 8 : at + 8 + size]
        at += 8 + size + size % 2


def jpeg_segments(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Yield markers and bytes of the segments before a JPEG's first scan (ITU-T T.81, B.1)."""
    view, at = memoryview(data), 2
    for _ in range(_MOST_PARTS if data[:2] == b"\xff\xd8" else 0):
        while data[at : at + 2] == b"\xff\xff":
            at += 1
        if at + 4 > len(data) or view[at] != 0xFF or view[at + 1] in (_SCAN, _END):
            return
        marker = view[at + 1]
        size = 0 if marker in _ALONE else int.from_bytes(view[at + 2 : at + 4], "big")
        if at + 2 + size > len(data):
            return
        yield marker, view[at + 4 : at + 2 + size]
        at += 2 + size


def count_gif_frames(data: bytes) -> int:
    """Return the number of frames in a GIF (GIF89a, sections 18 to 26)."""
    at = 13 + _colour_table(data[10])
    count = 0
    for _ in range(_MOST_PARTS):
        kind = data[at : at + 1]
        if kind == b",":
            count += 1
            at += 11 + _colour_table(int.from_bytes(data[at + 9 : at + 10], "big"))
        elif kind == b"!":
            at += 2
        else:
            return count
        # Data follow in blocks, each with its size before it, and end with an empty one.
        while size := int.from_bytes(data[at : at + 1], "big"):
            at += 1 + size
        at += 1
    return count


def _colour_table(flags: int) -> int:
    """Return the bytes of the colour table that the flags of a part of a GIF announce."""
    return 3 * 2 ** ((flags & 7) + 1) if flags & 0x80 else 0


def boxes(content: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Yield names and bytes of the boxes in a file or box (ISO/IEC 14496-12, section 4.2)."""
    at = 0
    for _ in range(_MOST_PARTS):
        size, name = int.from_bytes(content[at : at + 4], "big"), bytes(content[at + 4 : at + 8])
        start = at + 8
        if size == 1:
            size, start = int.from_bytes(content[at + 8 : at + 16], "big"), at + 16
        end = len(content) if size == 0 else at + size
        if len(name) < 4 or end < start or end > len(content):
            return
        yield name, content[start:end]
        at = end


def expand(compressed: memoryview | bytes) -> bytes | None:
    """Expand what deflate compressed; None if it is damaged or too large."""
    machine = zlib.decompressobj()
    try:
        found = machine.decompress(compressed, _MOST_EXPANDED)
    except zlib.error:
        return None
    return found if machine.eof else None


_EXIF = b"Exif\0"
_APP1 = 0xE1

_TEXT_PROFILES = (b"Raw profile type exif", b"Raw profile type APP1")
"""Keywords of the texts in which programs kept Exif before PNG had a chunk for it."""


def exif_of_jpeg(data: bytes) -> Exif | None:
    """Return the Exif in a JPEG's APP1 segment; None if there is none, or it is damaged."""
    for marker, content in jpeg_segments(data):
        if marker == _APP1 and content[:5] == _EXIF:
            return read_exif(bytes(content))
    return None


def exif_of_png(data: bytes) -> Exif | None:
    """Return the Exif in a PNG's eXIf chunk, or in the text that served before there was one."""
    older = None
    for name, content, is_intact in png_chunks(data):
        if name == b"eXIf" and is_intact:
            return read_exif(bytes(content))
        if name in (b"zTXt", b"tEXt") and is_intact:
            older = older or _text_profile(name, bytes(content))
    return older


def exif_of_webp(data: bytes) -> Exif | None:
    """Return the Exif in WebP's chunk (RFC 9649, section 2.7.1.5)."""
    chunks = riff_chunks(data)
    return next((read_exif(bytes(one)) for name, one in chunks if name == b"EXIF"), None)


def _text_profile(name: bytes, content: bytes) -> Exif | None:
    """Return the Exif that a text of a PNG holds as hexadecimal digits."""
    keyword, _, text = content.partition(b"\0")
    if keyword not in _TEXT_PROFILES:
        return None
    if name == b"zTXt":
        text = expand(text[1:]) or b""
    # The lines before the digits are the profile's name and its length in bytes.
    digits = b"".join(text.split()[2:])
    try:
        return read_exif(bytes.fromhex(digits.decode("ascii")))
    except ValueError:
        return None


def exif_after_offset(content: memoryview) -> Exif | None:
    """Return the Exif in a box or item, which begins with the place of the block after it."""
    return read_exif(bytes(content[4 + int.from_bytes(content[:4], "big") :]))
