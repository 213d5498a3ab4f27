"""What JPEG XL says of its picture before the picture itself (ISO/IEC 18181)."""

from __future__ import annotations

from dataclasses import dataclass

from labapp.files.exif import Exif
from labapp.files.picture.exif_in_files import exif_after_offset
from labapp.files.picture.file_parts import boxes

_CODESTREAM = b"\xff\x0a"

STARTS = (_CODESTREAM, b"\0\0\0\x0cJXL \r\n\x87\n")
"""First bytes of JPEG XL: the codestream, or boxes with it."""

_RATIOS = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))
"""Widths over heights that JPEG XL has numbers for."""

_WHOLE, _FLOATING = ((8, 0), (10, 0), (12, 0), (1, 6)), ((32, 0), (16, 0), (24, 0), (1, 6))
"""Bits of a sample of whole numbers and of floating point: offsets, and bits that add to them."""


@dataclass(frozen=True)
class JpegXLHeader:
    """Size in pixels, orientation as Exif counts it, and bits of a sample; None if not found."""

    width: int
    height: int
    orientation: int = 1
    bits: int | None = 8


def exif_of_jpeg_xl(data: bytes) -> Exif | None:
    """Return the Exif in JPEG XL's box (ISO/IEC 18181-2, section 9.4).

    Its orientation isn't the picture's: that stands in the picture's own header.
    """
    found = (content for name, content in boxes(memoryview(data)) if name == b"Exif")
    return next((exif_after_offset(one) for one in found), None)


def read_jpeg_xl_header(data: bytes) -> JpegXLHeader | None:
    """Parse the header of JPEG XL (ISO/IEC 18181-1, annex D); None for other formats."""
    if not data.startswith(_CODESTREAM):
        named = [one for one in boxes(memoryview(data)) if one[0] in (b"jxlc", b"jxlp")]
        if not named:
            return None
        # A part of a picture has its number before it.
        data = bytes(named[0][1][4:64] if named[0][0] == b"jxlp" else named[0][1][:60])
    if not data.startswith(_CODESTREAM):
        return None
    bits = _Bits(data[2:64])
    width, height = _take_size(bits)
    if bits.take(1):
        # All else is as usual.
        return JpegXLHeader(width, height)
    orientation = 1
    if bits.take(1):
        orientation = bits.take(3) + 1
        if bits.take(1):
            _take_size(bits)
        # A preview or an animation stands before the bits.
        if bits.take(1) or bits.take(1):
            return JpegXLHeader(width, height, orientation, None)
    choices = _FLOATING if bits.take(1) else _WHOLE
    return JpegXLHeader(width, height, orientation, bits.one_of(*choices))


class _Bits:
    """Numbers of some bits, the least significant first, as JPEG XL's header has them."""

    def __init__(self, data: bytes) -> None:
        self._rest = int.from_bytes(data, "little")

    def take(self, count: int) -> int:
        """Return the next bits as a number."""
        found = self._rest & ((1 << count) - 1)
        self._rest >>= count
        return found

    def one_of(self, *choices: tuple[int, int]) -> int:
        """Return a number by the choice that two bits name: its offset, and bits that follow."""
        offset, count = choices[self.take(2)]
        return offset + self.take(count)


def _take_size(bits: _Bits) -> tuple[int, int]:
    """Take width and height: multiples of 8 up to 256, or any."""
    small, sides = bits.take(1), ((1, 9), (1, 13), (1, 18), (1, 30))
    height = 8 * (bits.take(5) + 1) if small else bits.one_of(*sides)
    ratio = bits.take(3)
    if ratio:
        across, down = _RATIOS[ratio - 1]
        return height * across // down, height
    return 8 * (bits.take(5) + 1) if small else bits.one_of(*sides), height
