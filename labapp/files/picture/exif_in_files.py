"""Find the block of Exif in the files of JPEG, PNG, WebP, TIFF and JPEG XL."""

from __future__ import annotations

from labapp.files.picture.exif import Exif, read_exif
from labapp.files.picture.file_parts import (
    boxes,
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
    """Return the Exif in a JPEG file's APP1 segment; None if there is none, or it is damaged."""
    for marker, content in jpeg_segments(data):
        if marker == _APP1 and content[:5] == _EXIF:
            return read_exif(bytes(content))
    return None


def exif_of_png(data: bytes) -> Exif | None:
    """Return the Exif in a PNG file's eXIf chunk, or in the text that served before there was one.

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
    """Return the Exif in a WebP file's chunk (RFC 9649, section 2.7.1.5)."""
    found = (bytes(content) for name, content in riff_chunks(data) if name == b"EXIF")
    return next((read_exif(one) for one in found), None)


def exif_of_tiff(data: bytes, directory: int | None = None) -> Exif | None:
    """Return the Exif of a page of a TIFF file.

    directory: place of the page's directory in the file (tifffile's `page.offset`), by default the
    first page's.
    """
    return read_exif(data, directory)


def exif_of_jpeg_xl(data: bytes) -> Exif | None:
    """Return the Exif in a JPEG XL file's box (ISO/IEC 18181-2, section 9.4).

    Its orientation isn't the picture's: that stands in the picture's own header.
    """
    found = (content for name, content in boxes(memoryview(data)) if name == b"Exif")
    return next((exif_after_offset(one) for one in found), None)


def orientation_of_jpeg_xl(data: bytes) -> int | None:
    """Return the orientation in the header of a JPEG XL picture; None if it is no such file.

    See ISO/IEC 18181-1, annex D: the size, and then whether the metadata are all default.
    """
    if data[:2] != b"\xff\x0a":
        named = [one for one in boxes(memoryview(data)) if one[0] in (b"jxlc", b"jxlp")]
        if not named:
            return None
        # A part of a picture has its number before it.
        data = bytes(named[0][1][4:64] if named[0][0] == b"jxlp" else named[0][1][:60])
    if data[:2] != b"\xff\x0a":
        return None
    bits = _Bits(data[2:40])
    small = bits.take(1)
    bits.skip_size(small)
    if bits.take(3) == 0:
        bits.skip_size(small)
    all_default = bits.take(1)
    return 1 if all_default or not bits.take(1) else bits.take(3) + 1


def _text_profile(name: bytes, content: bytes) -> Exif | None:
    """Return the Exif that a text of a PNG file holds as hexadecimal digits."""
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


class _Bits:
    """Numbers of some bits, the least significant first, as JPEG XL's header has them."""

    def __init__(self, data: bytes) -> None:
        self._rest = int.from_bytes(data, "little")

    def take(self, count: int) -> int:
        """Return the next bits as a number."""
        found = self._rest & ((1 << count) - 1)
        self._rest >>= count
        return found

    def skip_size(self, small: int) -> None:
        """Pass over a width or height: multiples of 8 in 5 bits, or any in 9, 13, 18 or 30."""
        self.take(5 if small else (9, 13, 18, 30)[self.take(2)])
