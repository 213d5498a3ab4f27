"""What picture files say of their encoding, and how PNG is told it.

PNG says it in up to four chunks, the most exact of which holds (W3C, PNG third edition, section
4.3): cICP, iCCP, sRGB, gAMA. JPEG, WebP and others have at most an ICC profile.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

from labapp.common.drawing_mark import DRAWING
from labapp.common.errors import UserError
from labapp.files.picture.encoding import (
    BT709,
    HLG,
    LINEAR,
    PQ,
    SRGB,
    Encoding,
    Statement,
    gamma_encoding,
)
from labapp.files.picture.file_parts import (
    PNG,
    expand,
    jpeg_segments,
    png_chunks,
    riff_chunks,
)
from labapp.files.picture.icc import icc_encoding

UNSPECIFIED = 2
_TRANSFERS = {
    **dict.fromkeys((1, 6, 14, 15), BT709),
    4: gamma_encoding(2.2),
    5: gamma_encoding(2.8),
    8: LINEAR,
    13: SRGB,
    16: PQ,
    18: HLG,
}
"""Encodings by the number of their transfer characteristics (ITU-T H.273, table 3)."""

_PRIMARIES = {9: "BT.2020", 11: "DCI-P3", 12: "Display P3"}
_SRGB_PRIMARIES = (1, UNSPECIFIED)
"""Numbers of colour primaries (ITU-T H.273, table 2); 1 are sRGB's."""

_APP2, _ICC_IN_JPEG = 0xE2, b"ICC_PROFILE\0"
_GAMMA_UNIT = 100000
"""gAMA's number for an exponent of 1 (PNG third edition, section 11.3.2.2)."""

_SRGB_GAMMA = 45455
"""gAMA's number beside sRGB, for readers that don't know that chunk (section 11.3.2.5)."""

_AFTER_HEADER = len(PNG) + 25
"""Place after the first chunk of a PNG, which has 13 bytes."""


def png_encoding(data: bytes) -> Statement:
    """Return the encoding by a PNG's chunks.

    Damaged chunks are passed over, which a note tells. Raises UserError, without the file's name,
    if the file's encoding is one that labapp can't turn into light.
    """
    found: dict[bytes, bytes] = {}
    notes: list[str] = []
    for name, content, is_intact in png_chunks(data):
        if name in _READERS:
            if is_intact:
                found.setdefault(name, bytes(content))
            else:
                notes.append(f"its chunk {name.decode()} is damaged and was passed over")
    for name, read in _READERS.items():
        stated = read(found[name]) if name in found else Statement(None)
        notes += stated.notes
        if stated.encoding is not None:
            return Statement(stated.encoding, stated.source, tuple(notes))
    return Statement(None, "", tuple(notes))


def icc_of_jpeg(data: bytes) -> bytes | None:
    """Return the ICC profile in a JPEG's segments; None if there is none that is whole."""
    parts = {}
    for marker, content in jpeg_segments(data):
        if marker == _APP2 and content[:12] == _ICC_IN_JPEG and len(content) > 14:
            parts[content[12]] = (content[13], bytes(content[14:]))
    counts = {count for count, _ in parts.values()}
    if len(counts) != 1 or sorted(parts) != list(range(1, counts.pop() + 1)):
        return None
    return b"".join(parts[number][1] for number in sorted(parts))


def icc_of_webp(data: bytes) -> bytes | None:
    """Return the ICC profile in WebP's chunk (RFC 9649, section 2.7.1.4)."""
    return next((bytes(one) for name, one in riff_chunks(data) if name == b"ICCP"), None)


def png_with_encoding(png: bytes, encoding: Encoding) -> bytes:
    """Return a PNG that says how its levels stand for light.

    png: bytes of a file without such chunks.
    Raises ValueError for an ICC profile's curves.
    """
    if encoding.curves is not None:
        raise ValueError("encoding is that of an ICC profile, which isn't written")
    chunks = b""
    if encoding.name == "srgb":
        # The rendering intent 0 is the one for photographs.
        chunks = _chunk(b"gAMA", struct.pack(">I", _SRGB_GAMMA)) + _chunk(b"sRGB", b"\0")
    else:
        gamma = 1.0 if encoding.name == "linear" else None
        if encoding.name.startswith("gamma "):
            gamma = float(encoding.name.removeprefix("gamma "))
        if gamma:
            chunks += _chunk(b"gAMA", struct.pack(">I", round(_GAMMA_UNIT / gamma)))
        number = next((k for k, one in _TRANSFERS.items() if one.name == encoding.name), None)
        if number is not None:
            chunks += _chunk(b"cICP", bytes((1, number, 0, 1)))
    return png[:_AFTER_HEADER] + chunks + png[_AFTER_HEADER:]


def mark_drawing(png: bytes) -> bytes:
    """Return a PNG that says that it is a drawing of numbers, which it doesn't hold."""
    text = _chunk(b"tEXt", b"Description\0" + DRAWING.encode("latin-1"))
    return png[:_AFTER_HEADER] + text + png[_AFTER_HEADER:]


def is_drawing(png: bytes) -> bool:
    """Return whether a PNG says that it is a drawing that labapp made to look at."""
    said = b"Description\0" + DRAWING.encode("latin-1")
    return any(one.name == b"tEXt" and one.content == said for one in png_chunks(png))


def _chunk(name: bytes, content: bytes) -> bytes:
    """Return a PNG's chunk, with length and check sum."""
    check = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", check)


def _read_cicp(content: bytes) -> Statement:
    """Return the encoding by the code points of a chunk (PNG third edition, section 11.3.2.6)."""
    if len(content) != 4:
        return Statement(None, "", ("its chunk cICP is damaged and was passed over",))
    primaries, transfer, matrix, full = content
    if transfer == UNSPECIFIED:
        return Statement(None)
    if matrix or full != 1:
        raise UserError(
            "its levels are those of video by its chunk cICP (not RGB of the full range). Convert "
            "it to a PNG of full range, or name its encoding."
        )
    return code_point_encoding(primaries, transfer, "its chunk cICP")


def code_point_encoding(primaries: int, transfer: int, source: str) -> Statement:
    """Return the encoding by the numbers of ITU-T H.273; `source` says where they stand.

    Raises UserError, without the file's name, for one that labapp can't turn into light.
    """
    if transfer not in _TRANSFERS:
        raise UserError(
            f"its levels have the transfer characteristics {transfer} of ITU-T H.273 by {source}, "
            "which labapp doesn't know. Convert it to sRGB, or name its encoding."
        )
    notes: tuple[str, ...] = ()
    if primaries not in _SRGB_PRIMARIES:
        space = _PRIMARIES.get(primaries, f"number {primaries} of ITU-T H.273")
        notes = (f"its colours are those of {space}, and not sRGB's; they are kept",)
    return Statement(_TRANSFERS[transfer], source, notes)


def _read_iccp(content: bytes) -> Statement:
    """Return the encoding by the ICC profile in a chunk: name, method and compressed profile."""
    profile = expand(content.partition(b"\0")[2][1:])
    if profile is None:
        return Statement(None, "", ("its ICC profile is damaged and was passed over",))
    return icc_encoding(profile)


def _read_gama(content: bytes) -> Statement:
    """Return the encoding by a chunk's exponent from light to levels, in units of 0.00001."""
    value = int.from_bytes(content, "big")
    if len(content) != 4 or not 0.1 <= value / _GAMMA_UNIT <= 10:
        return Statement(None, "", ("its chunk gAMA holds no sensible number and was passed over",))
    # Four digits are what the chunk's own rounding leaves: 45455 stands for 2.2.
    return Statement(gamma_encoding(float(f"{_GAMMA_UNIT / value:.4g}")), "its chunk gAMA")


_READERS: dict[bytes, Callable[[bytes], Statement]] = {
    b"cICP": _read_cicp,
    b"iCCP": _read_iccp,
    b"sRGB": lambda content: Statement(SRGB, "its chunk sRGB"),
    b"gAMA": _read_gama,
}
"""Functions that read a chunk's encoding, by its name; the first that says something holds."""
