"""What AVIF and HEIF say of their picture: Exif, orientation and encoding.

The picture and the block of Exif are items of the file; turning, mirroring and colours are
properties that items refer to (ISO/IEC 23008-12, and ISO/IEC 14496-12 for the boxes).
"""

from __future__ import annotations

import struct

from labapp.files.exif import Exif
from labapp.files.picture.encoding import Statement
from labapp.files.picture.exif_in_files import exif_after_offset
from labapp.files.picture.file_parts import boxes
from labapp.files.picture.icc import icc_encoding
from labapp.files.picture.stated_encoding import UNSPECIFIED, code_point_encoding

_ORIENTATIONS = {
    (0, None): 1,
    (0, 1): 2,
    (0, 0): 4,
    (1, None): 8,
    (1, 1): 7,
    (1, 0): 5,
    (2, None): 3,
    (2, 1): 4,
    (2, 0): 2,
    (3, None): 6,
    (3, 1): 5,
    (3, 0): 7,
}
"""Exif's orientation by the quarter turns against the clock (irot) and the mirroring after them
(imir: 0 exchanges top and bottom, 1 left and right; ISO/IEC 23008-12, section 6.5)."""

_MOST_ITEMS = 10_000
"""Items of a HEIF file that are looked at: large photographs consist of some hundred. Chosen."""


def exif_of_heif(data: bytes) -> Exif | None:
    """Return the Exif in an item of AVIF or HEIF (ISO/IEC 23008-12, annex A).

    Its orientation isn't the picture's: that is told by the properties irot and imir.
    """
    meta = _meta(data)
    wanted = _exif_item(meta.get(b"iinf"))
    if wanted is None:
        return None
    place = _item_place(meta.get(b"iloc"), wanted)
    if place is None:
        return None
    start, size = place
    return exif_after_offset(memoryview(data)[start : start + size])


def orientation_of_heif(data: bytes) -> int:
    """Return the orientation, 1 to 8, by the properties of AVIF or HEIF.

    The turning (irot) comes before the mirroring (imir; ISO/IEC 23000-22, section 7.3.6.7).
    """
    turns, mirror = 0, None
    for name, content in _properties(data):
        if name == b"irot" and len(content):
            turns = content[0] & 3
        if name == b"imir" and len(content):
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
    numbers = _associations(boxed.get(b"ipma"), _primary_item(meta.get(b"pitm")))
    return [known[at - 1] for at in numbers if 0 < at <= len(known)]


def _primary_item(box: memoryview | None) -> int:
    """Return the number of the item that is the picture; 0 if the file names none."""
    return 0 if not box else int.from_bytes(box[4 : 6 if box[0] == 0 else 8], "big")


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


def _item_place(box: memoryview | None, wanted: int) -> tuple[int, int] | None:
    """Return place and size of an item that lies in one piece (ISO/IEC 14496-12)."""
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
                return (start, size) if pieces == 1 and not inside else None
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
