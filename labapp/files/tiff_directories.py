"""Directories of tags in TIFF, and in Exif and RAW files that are built alike."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from functools import cached_property

Number = int | float

_BIG = {b"II+\0", b"MM\0+"}
"""First bytes of BigTIFF, whose offsets have 64 bits."""

_TIFF = {b"II*\0", b"MM\0*"} | _BIG
"""First bytes of TIFF (Adobe, TIFF 6.0, section 2)."""

_TIFF_LIKE = _TIFF | {b"IIU\0", b"IIRO", b"IIRS", b"MMOR"}
"""Those of Panasonic's and Olympus' RAW, too, which differ from TIFF in these bytes only."""

_MOST_ENTRIES = 1 << 16
"""Tags of a directory that are looked at, as many as TIFF can count; BigTIFF could have more."""

_TEXT = 2
"""Type of a tag's value that is text."""

_MOST_DIRECTORIES = 100
"""Directories that are looked at. Chosen: cameras write up to ten; a chain in a circle ends."""

_FORMS = {
    1: "B", 2: "B", 3: "H", 4: "L", 6: "b", 7: "B", 8: "h", 9: "l", 11: "f", 12: "d", 13: "L",
    16: "Q", 17: "q", 18: "Q",
}  # fmt: skip
"""Codes of the module `struct` by the type of a tag's values, but for rational numbers."""

_RATIONAL = {5: "L", 10: "l"}
"""Codes of a rational number's two parts by the type of a tag's values."""

SUB_DIRECTORIES, _STRIPS, _TILES = 330, (273, 279), (324, 325)
"""Tags with offsets of further directories, and with offsets and sizes of a picture's parts."""

PANASONIC_OFFSET = 280
"""Tag with the offset of Panasonic's RAW numbers, where that of its strips is all ones."""


@dataclass(frozen=True)
class _Layout:
    """How TIFF's numbers are laid out: their order, a tag, the number of tags, and an offset."""

    order: str
    entry: struct.Struct
    count: struct.Struct
    offset: struct.Struct


@dataclass(frozen=True, eq=False)
class Directory:
    """A directory of tags, at an offset of a file's data, which describes one of its pictures."""

    data: bytes
    offset: int
    layout: _Layout

    @cached_property
    def _entries(self) -> dict[int, tuple[int, int, bytes]]:
        """Type, count and bytes of the value, or of its offset, of each tag."""
        entry = self.layout.entry
        (count,) = self.layout.count.unpack_from(self.data, self.offset)
        start = self.offset + self.layout.count.size
        room = (len(self.data) - start) // entry.size
        rows = (
            entry.unpack_from(self.data, start + number * entry.size)
            for number in range(min(count, room, _MOST_ENTRIES))
        )
        # Of a tag that is there twice, the first counts.
        return {code: (kind, n, value) for code, kind, n, value in reversed(list(rows))}

    @property
    def next_offset(self) -> int:
        """Offset of the next page's directory; 0 for the last one."""
        entries = self.layout.count.unpack_from(self.data, self.offset)[0]
        end = self.offset + self.layout.count.size + entries * self.layout.entry.size
        if end + self.layout.offset.size > len(self.data):
            return 0
        return int(self.layout.offset.unpack_from(self.data, end)[0])

    def has(self, code: int) -> bool:
        """Return whether the directory has a tag."""
        return code in self._entries

    def numbers(self, code: int, most: int | None = None) -> tuple[Number, ...]:
        """Return the values of a tag; none if it is missing, or isn't wholly in the file.

        most: values that are read; None for all.
        """
        kind, count, held = self._entries.get(code, (0, 0, b""))
        form = _FORMS.get(kind) or _RATIONAL.get(kind)
        if form is None or count > len(self.data):
            return ()
        parts = count * (2 if kind in _RATIONAL else 1)
        layout = struct.Struct(f"{self.layout.order}{parts}{form}")
        if layout.size <= len(held):
            source, at = held, 0
        else:
            source, at = self.data, int(self.layout.offset.unpack(held)[0])
        if at + layout.size > len(source):
            return ()
        if most is not None and count > most:
            layout = struct.Struct(f"{self.layout.order}{parts // count * most}{form}")
        found: tuple[Number, ...] = layout.unpack_from(source, at)
        if kind not in _RATIONAL:
            return found
        return tuple(a / b if b else math.nan for a, b in zip(found[::2], found[1::2], strict=True))

    @property
    def lost(self) -> list[int]:
        """Tags whose values lie beyond the end of the file."""
        known = _FORMS.keys() | _RATIONAL.keys()
        return [
            code
            for code, (kind, count, _) in self._entries.items()
            if kind in known and count and not self.numbers(code)
        ]

    def number(self, code: int, default: int) -> int:
        """Return the first value of a tag as a whole number; `default` if it is missing."""
        found = self.numbers(code)
        return int(found[0]) if found and math.isfinite(found[0]) else default

    def is_text(self, code: int) -> bool:
        """Return whether a tag's value is text."""
        return code in self._entries and self._entries[code][0] == _TEXT

    def text(self, code: int, most: int | None = None) -> str:
        """Return the text of a tag, of `most` bytes; empty if it is missing, or is no text."""
        if not self.is_text(code):
            return ""
        held = bytes(int(one) for one in self.numbers(code, most))
        return held.partition(b"\0")[0].decode("utf-8", "replace").strip()

    def sub_directory(self, code: int) -> Directory | None:
        """Return the directory that a tag leads to; None if there is none."""
        at = self.number(code, 0)
        if not 0 < at < len(self.data) - self.layout.count.size:
            return None
        return Directory(self.data, at, self.layout)

    @property
    def parts(self) -> list[tuple[int, int]]:
        """Offset and size of each strip or tile of the picture."""
        if self.numbers(_STRIPS[0]) == (0xFFFFFFFF,):
            return [(self.number(PANASONIC_OFFSET, 0), self.number(_STRIPS[1], 0))]
        for offsets, sizes in (_TILES, _STRIPS):
            if self.has(offsets):
                pairs = zip(self.numbers(offsets), self.numbers(sizes), strict=False)
                return [(int(at), int(size)) for at, size in pairs]
        return []


def is_tiff(data: bytes) -> bool:
    """Return whether bytes begin as TIFF does."""
    return data[:4] in _TIFF


def is_tiff_like(data: bytes) -> bool:
    """Return whether bytes begin as TIFF does, or as RAW that is built like it."""
    return data[:4] in _TIFF_LIKE


def read_directory(data: bytes, offset: int | None = None) -> Directory | None:
    """Return the directory at an offset, by default the first; None if there is none."""
    layout, first = _read_header(data)
    return None if layout is None else _collect(data, offset or first, layout, {})


def read_directories(data: bytes) -> list[Directory]:
    """Return the directories of all pages, each followed by those that it leads to.

    What is damaged is left out; the list is empty for files of another kind.
    """
    layout, first = _read_header(data)
    if layout is None:
        return []
    found: dict[int, Directory] = {}
    offset = first
    while (page := _collect(data, offset, layout, found)) is not None:
        for at in page.numbers(SUB_DIRECTORIES):
            _collect(data, int(at), layout, found)
        offset = page.next_offset
    return list(found.values())


def _read_header(data: bytes) -> tuple[_Layout | None, int]:
    """Return the layout of numbers and the offset of the first page, or None and 0."""
    if not is_tiff_like(data):
        return None, 0
    order, is_big = "<" if data[:2] == b"II" else ">", data[:4] in _BIG
    forms = ("HHQ8s", "Q", "Q") if is_big else ("HHL4s", "H", "L")
    layout = _Layout(order, *(struct.Struct(order + form) for form in forms))
    try:
        (first,) = layout.offset.unpack_from(data, 8 if is_big else 4)
    except struct.error:
        return None, 0
    return layout, int(first)


def _collect(
    data: bytes, offset: int, layout: _Layout, found: dict[int, Directory]
) -> Directory | None:
    """Add a directory to `found`; None if there is none, or it's there already."""
    inside = 0 < offset <= len(data) - layout.count.size
    if not inside or offset in found or len(found) >= _MOST_DIRECTORIES:
        return None
    found[offset] = Directory(data, offset, layout)
    return found[offset]
