"""What AVIF, HEIF and JPEG XL say of their picture: Exif, orientation, and size or encoding.

In AVIF and HEIF, the picture and the block of Exif are items of the file; turning, mirroring and
colours are properties that items refer to, and Exif's orientation isn't the picture's (ISO/IEC
23008-12, and ISO/IEC 14496-12 for the boxes).
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from labapp.files.exif import Exif
from labapp.files.picture.encoding import Statement
from labapp.files.picture.file_parts import boxes, exif_after_offset
from labapp.files.picture.icc import icc_encoding
from labapp.files.picture.stated_encoding import UNSPECIFIED, code_point_encoding

_ORIENTATIONS = {
    (0, None): 1, (0, 1): 2, (0, 0): 4, (1, None): 8, (1, 1): 7, (1, 0): 5,
    (2, None): 3, (2, 1): 4, (2, 0): 2, (3, None): 6, (3, 1): 5, (3, 0): 7,
}  # fmt: skip
"""Exif's orientation by the quarter turns against the clock (irot) and the mirroring after them
(imir: 0 exchanges top and bottom, 1 left and right; ISO/IEC 23008-12, section 6.5)."""

_MOST_ITEMS = 10_000
"""Items of a HEIF file that are looked at: large photographs consist of some hundred. Chosen."""


def exif_of_heif(data: bytes) -> Exif | None:
    """Return the Exif in an item of AVIF or HEIF (ISO/IEC 23008-12, annex A)."""
    meta = _meta(data)
    wanted = _exif_item(meta.get(b"iinf"))
    if wanted is None:
        return None
    place = _item_place(meta.get(b"iloc"), wanted)
    return None if place is None else exif_after_offset(memoryview(data)[place])


def orientation_of_heif(data: bytes) -> int:
    """Return the orientation, 1 to 8, by the properties of AVIF or HEIF.

    The turning (irot) comes before the mirroring (imir; ISO/IEC 23000-22, section 7.3.6.7).
    """
    turns, mirror = 0, None
    for name, content in _properties(data):
        if name == b"irot" and content:
            turns = content[0] & 3
        if name == b"imir" and content:
            mirror = content[0] & 1
    return _ORIENTATIONS[turns, mirror]


def heif_encoding(data: bytes) -> Statement:
    """Return the encoding by the colour boxes of AVIF or HEIF.

    An ICC profile holds before numbers (ISO/IEC 14496-12, section 12.1.5). Raises UserError,
    without the file's name, if the encoding is one that labapp can't turn into light.
    """
    colours = [content for name, content in _properties(data) if name == b"colr"]
    for content in colours:
        if bytes(content[:4]) in (b"prof", b"rICC"):
            return icc_encoding(bytes(content[4:]))
    for content in colours:
        if bytes(content[:4]) == b"nclx" and len(content) >= 11:
            primaries, transfer = struct.unpack_from(">HH", content, 4)
            if transfer != UNSPECIFIED:
                return code_point_encoding(primaries, transfer, "its colour box")
    return Statement(None)


def _meta(data: bytes) -> dict[bytes, memoryview]:
    """Return the boxes in the box of metadata, which begins with version and flags."""
    top = (content for name, content in boxes(memoryview(data)) if name == b"meta")
    return dict(boxes(next(top, memoryview(b""))[4:]))


def _properties(data: bytes) -> list[tuple[bytes, memoryview]]:
    """Return names and bytes of the properties of the item that is the picture."""
    meta = _meta(data)
    boxed = dict(boxes(meta.get(b"iprp", memoryview(b""))))
    known = list(boxes(boxed.get(b"ipco", memoryview(b""))))
    # The item that is the picture; 0 if the file names none.
    pitm = meta.get(b"pitm")
    item = int.from_bytes(pitm[4 : 6 if pitm[0] == 0 else 8], "big") if pitm else 0
    numbers = _associations(boxed.get(b"ipma"), item)
    return [known[at - 1] for at in numbers if 0 < at <= len(known)]


def _exif_item(box: memoryview | None) -> int | None:
    """Return the number of the item that is a block of Exif."""
    if not box:
        return None
    for name, entry in boxes(box[6 if box[0] == 0 else 8 :]):
        if name == b"infe" and len(entry) > 12 and entry[0] in (2, 3):
            wide = 2 if entry[0] == 2 else 4
            if bytes(entry[6 + wide : 10 + wide]) == b"Exif":
                return int.from_bytes(entry[4 : 4 + wide], "big")
    return None


def _item_place(box: memoryview | None, wanted: int) -> slice | None:
    """Return the place of an item that lies in one piece (ISO/IEC 14496-12)."""
    if not box or len(box) < 8 or box[0] > 2:
        return None
    version, numbers = box[0], _Numbers(box[6:])
    wide, sizes = (4 if version == 2 else 2), (box[4] >> 4, box[4] & 15, box[5] >> 4)
    index = box[5] & 15 if version else 0
    for _ in range(min(numbers.take(wide), _MOST_ITEMS)):
        item = numbers.take(wide)
        inside = numbers.take(2) & 15 if version else 0
        numbers.take(2)
        base, pieces = numbers.take(sizes[2]), numbers.take(2)
        for _ in range(min(pieces, _MOST_ITEMS)):
            numbers.take(index)
            start, size = base + numbers.take(sizes[0]), numbers.take(sizes[1])
            if item == wanted:
                return slice(start, start + size) if pieces == 1 and not inside else None
    return None


def _associations(box: memoryview | None, item: int) -> list[int]:
    """Return the numbers, from 1, of the properties that belong to an item."""
    if not box or len(box) < 8:
        return []
    wide, numbers = (2 if box[0] == 0 else 4), _Numbers(box[4:])
    large = 2 if box[3] & 1 else 1
    for _ in range(min(numbers.take(4), _MOST_ITEMS)):
        owner = numbers.take(wide)
        # The highest bit says that a reader must know the property.
        found = [
            numbers.take(large) & (0x7FFF if large == 2 else 0x7F) for _ in range(numbers.take(1))
        ]
        if owner == item:
            return found
    return []


class _Numbers:
    """Whole numbers of some bytes after each other, the most significant first; 0 after the end."""

    def __init__(self, content: memoryview) -> None:
        self._content, self._at = content, 0

    def take(self, size: int) -> int:
        """Return the next number."""
        found = int.from_bytes(self._content[self._at : self._at + size], "big")
        self._at += size
        return found


_CODESTREAM = b"\xff\x0a"

STARTS = (_CODESTREAM, b"\0\0\0\x0cJXL \r\n\x87\n")
"""First bytes of JPEG XL: the codestream, or boxes with it."""

_RATIOS = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))
"""Widths over heights that JPEG XL has numbers for."""

_WHOLE, _FLOATING = ((8, 0), (10, 0), (12, 0), (1, 6)), ((32, 0), (16, 0), (24, 0), (1, 6))
"""Bits of a sample of whole numbers and of floating point: offsets, and bits that add to them."""


class JpegXLHeader(NamedTuple):
    """Size in pixels, orientation as Exif counts it, and bits of a sample; None if not found."""

    width: int
    height: int
    orientation: int = 1
    bits: int | None = 8


def exif_of_jpeg_xl(data: bytes) -> Exif | None:
    """Return the Exif in JPEG XL's box (ISO/IEC 18181-2, section 9.4)."""
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
