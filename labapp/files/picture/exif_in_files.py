"""Where the block of Exif lies in JPEG, PNG and WebP, and in boxes of HEIF and JPEG XL."""

from __future__ import annotations

from labapp.files.exif import Exif, read_exif
from labapp.files.picture.file_parts import (
    expand,
    jpeg_segments,
    png_chunks,
    riff_chunks,
)

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
    """Return the Exif in a PNG's eXIf chunk, or in the text that served before there was one.

    A chunk with a wrong check sum is passed over.
    """
    older = None
    for name, content, is_intact in png_chunks(data):
        if name == b"eXIf" and is_intact:
            return read_exif(bytes(content))
        if name in (b"zTXt", b"tEXt") and is_intact:
            older = older or _text_profile(name, bytes(content))
    return older


def exif_of_webp(data: bytes) -> Exif | None:
    """Return the Exif in WebP's chunk (RFC 9649, section 2.7.1.5)."""
    found = (bytes(content) for name, content in riff_chunks(data) if name == b"EXIF")
    return next((read_exif(one) for one in found), None)


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
