"""Curves of ICC profiles, and small profiles to write (ICC.1:2022; ICC.1:2001 for version 2).

A profile with a matrix has a curve for each colour, from a file's levels to linear light, and the
places of its primary colours. Only the curves are used: light stays in the profile's own red,
green and blue, and a note tells where these aren't those of sRGB.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.plain_text import printable_line, shorten
from labapp.files.picture.encoding import BT709, LINEAR, SRGB, Encoding, Statement, gamma_encoding

_HEADER = 128
"""Bytes of a profile's header (ICC.1:2022, section 7.2)."""

_SIGNATURE, _SPACE = slice(36, 40), slice(16, 20)
_MOST_TAGS = 200
"""Tags of a profile that are looked at; profiles have 10 to 40. Chosen."""

_NODES = 65536
"""Nodes of a curve: one for each level of 16 bits, among which are those of 8 bits."""

_COLOUR_CURVES = (b"rTRC", b"gTRC", b"bTRC")
_TABLES = (b"A2B0", b"A2B1", b"A2B2")

PRIMARIES = {
    b"rXYZ": (0.436066, 0.222488, 0.013916),
    b"gXYZ": (0.385147, 0.716873, 0.097076),
    b"bXYZ": (0.143066, 0.060608, 0.714096),
}
"""sRGB's primary colours under D50, to which profiles adapt them by Bradford's matrix (ICC, "How to
interpret the sRGB color space in ICC profiles")."""

_SAME_PRIMARIES = 0.004
"""Highest difference of primaries that count as sRGB's: versions of its profile differ by .002, and
the nearest other space (BT.601) by .02. Chosen."""


def icc_encoding(profile: bytes) -> Statement:
    """Return the encoding by the curves of an ICC profile, with notes.

    A damaged profile says nothing, which a note tells. Raises UserError, without the file's name,
    if the profile has no curves but tables of colours.
    """
    tags = _read_tags(profile)
    if tags is None:
        return Statement(None, "", ("its ICC profile is damaged and was passed over",))
    name = _describe(tags)
    names = [tag for tag in _COLOUR_CURVES if tag in tags] or [b"kTRC"]
    curves = [tags[tag] for tag in names if tag in tags]
    if not curves and any(tag in tags for tag in _TABLES):
        raise UserError(
            f"its ICC profile {name} has a table of colours instead of curves, from which labapp "
            "takes no light. Convert the picture to sRGB, or name its encoding."
        )
    tables = [_parse_curve(one) for one in curves]
    known = [one for one in tables if one is not None]
    if not known or len(known) != len(tables) or len(tables) == 2:
        return Statement(None, "", (f"the curves of its ICC profile {name} can't be read",))
    return Statement(_name_curves(known), f"its ICC profile {name}", _note_primaries(tags, name))


def icc_profile(encoding: Encoding, bands: int = 3) -> bytes:
    """Return a small ICC profile of version 4 for linear or sRGB light, grey or with sRGB's bands.

    Raises ValueError for other encodings.
    """
    if encoding.name not in ("linear", "srgb"):
        raise ValueError(f"encoding is {encoding.name}; profiles are written for linear and srgb")
    words = "sRGB" if encoding.name == "srgb" else "Linear light"
    words += ", primaries of sRGB" if bands == 3 else ", grey"
    curve = _SRGB_CURVE if encoding.name == "srgb" else struct.pack(">4s4xI", b"curv", 0)
    tags = {
        b"desc": _text_tag(words),
        b"cprt": _text_tag("Not copyrighted"),
        b"wtpt": _xyz_tag(_D50),
        b"chad": struct.pack(">4s4x9i", b"sf32", *(round(65536 * one) for one in _ADAPTATION)),
    }
    if bands == 3:
        tags |= {tag: _xyz_tag(place) for tag, place in PRIMARIES.items()}
    tags |= dict.fromkeys(_COLOUR_CURVES if bands == 3 else (b"kTRC",), curve)
    return _assemble(tags, b"RGB " if bands == 3 else b"GRAY")


_D50 = (0.96420288, 1.0, 0.8249054)
"""The white to which profiles adapt (ICC.1:2022, section 7.2.16)."""

_ADAPTATION = (
    *(1.047882, 0.022919, -0.050201),
    *(0.029587, 0.990479, -0.017059),
    *(-0.009232, 0.015076, 0.751678),
)
"""Bradford's matrix from D65 to D50, row by row (ICC.1:2022, annex E)."""

_SRGB_CURVE = struct.pack(
    ">4s4xHxx5i",
    b"para",
    3,
    *(round(65536 * one) for one in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)),
)


def _read_tags(profile: bytes) -> dict[bytes, bytes] | None:
    """Return a profile's tags; None if it is none, or damaged."""
    if profile[_SIGNATURE] != b"acsp" or len(profile) < _HEADER + 4:
        return None
    found: dict[bytes, bytes] = {}
    (count,) = struct.unpack_from(">I", profile, _HEADER)
    for k in range(min(count, _MOST_TAGS)):
        entry = profile[_HEADER + 4 + 12 * k : _HEADER + 16 + 12 * k]
        if len(entry) < 12:
            return None
        name, at, size = struct.unpack(">4sII", entry)
        if at + size > len(profile):
            return None
        found[name] = profile[at : at + size]
    return found


def _parse_curve(tag: bytes) -> Encoding | NDArray[np.float64] | None:
    """Return a curve's encoding if it is a plain power, else its light at all nodes.

    None stands for a curve that can't be read (ICC.1:2022, sections 10.6 and 10.18).
    """
    try:
        if tag[:4] == b"curv":
            (count,) = struct.unpack_from(">I", tag, 8)
            if count == 0:
                return LINEAR
            values = np.array(struct.unpack_from(f">{count}H", tag, 12))
            if count == 1:
                return gamma_encoding(values[0] / 256) if values[0] else None
            light = np.interp(np.linspace(0, 1, _NODES), np.linspace(0, 1, count), values / 65535)
            return light if light[-1] > light[0] else None
        if tag[:4] == b"para":
            (kind,) = struct.unpack_from(">H", tag, 8)
            numbers = struct.unpack_from(f">{(1, 3, 4, 5, 7)[kind]}i", tag, 12)
            return _parametric(kind, *(one / 65536 for one in numbers))
    except (struct.error, IndexError, MemoryError):
        pass
    return None


def _parametric(kind: int, *numbers: float) -> Encoding | NDArray[np.float64] | None:
    """Return a parametric curve's light at all nodes (ICC.1:2022, table 68), clipped to 0 to 1.

    With X for the level, it is (aX + b)^g + e from X = d on, and cX + f below.
    """
    g, a, b, c, d, e, f = (*numbers, *(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)[len(numbers) :])
    if g <= 0 or (a == 0 and kind in (1, 2)):
        return None
    if kind == 0:
        return gamma_encoding(float(f"{g:.5g}"))
    if kind in (1, 2):
        # Below, kind 1 is 0, and kind 2 the constant that kind 1 adds nothing of.
        d, e, f, c = -b / a, c if kind == 2 else 0.0, c if kind == 2 else 0.0, 0.0
    levels = np.linspace(0, 1, _NODES)
    with np.errstate(all="ignore"):
        power = np.maximum(a * levels + b, 0) ** g + e
        light = np.clip(np.where(levels >= d, power, c * levels + f), 0, 1)
    return light if light[-1] > light[0] else None


def _name_curves(curves: list[Encoding | NDArray[np.float64]]) -> Encoding:
    """Return the encoding of a profile's one or three curves, by its name if it is a known one."""
    first = curves[0]
    if isinstance(first, Encoding) and all(
        isinstance(one, Encoding) and one.name == first.name for one in curves
    ):
        return first
    levels = np.linspace(0, 1, _NODES)
    tables = np.stack(
        [one.to_light(levels) if isinstance(one, Encoding) else one for one in curves]
    )
    for known, steps in ((LINEAR, 65535), (SRGB, 255), (BT709, 255)):
        # Half a step is what rounding to levels changes.
        if np.abs(known.from_light(tables) - levels).max() <= 0.5 / steps:
            return known
    return Encoding("icc", tables[:1] if (tables == tables[0]).all() else tables)


def _note_primaries(tags: dict[bytes, bytes], name: str) -> tuple[str, ...]:
    """Return a note if a profile's primary colours aren't sRGB's; light stays in them."""
    for name_of, primary in PRIMARIES.items():
        tag = tags.get(name_of, b"")
        if tag[:4] != b"XYZ " or len(tag) < 20:
            continue
        place = [one / 65536 for one in struct.unpack_from(">3i", tag, 8)]
        if not np.allclose(place, primary, rtol=0, atol=_SAME_PRIMARIES):
            break
    else:
        return ()
    return (f"its colours are those of its ICC profile {name}, and not sRGB's; they are kept",)


def _describe(tags: dict[bytes, bytes]) -> str:
    """Return a profile's name in quotes, from version 2's or version 4's description."""
    tag = tags.get(b"desc", b"")
    text = ""
    if tag[:4] == b"desc":
        text = tag[12:].partition(b"\0")[0].decode("ascii", "replace")
    if tag[:4] == b"mluc" and len(tag) >= 28:
        size, at = struct.unpack_from(">II", tag, 20)
        text = tag[at : at + min(size, 400)].decode("utf-16-be", "replace")
    return f'"{shorten(printable_line(text.strip()), 60)}"' if text else "without a name"


def _text_tag(words: str) -> bytes:
    """Return a text in English as a tag (multiLocalizedUnicodeType)."""
    text = words.encode("utf-16-be")
    return struct.pack(">4s4xII2s2sII", b"mluc", 1, 12, b"en", b"US", len(text), 28) + text


def _xyz_tag(place: tuple[float, ...]) -> bytes:
    return struct.pack(">4s4x3i", b"XYZ ", *(round(65536 * one) for one in place))


def _assemble(tags: dict[bytes, bytes], space: bytes) -> bytes:
    """Return a profile for displays of its tags; equal tags are stored once."""
    body, table, places = b"", b"", {}
    start = _HEADER + 4 + 12 * len(tags)
    for name, tag in tags.items():
        if tag not in places:
            places[tag] = start + len(body)
            body += tag + bytes(-len(tag) % 4)
        table += struct.pack(">4sII", name, places[tag], len(tag))
    header = bytearray(_HEADER)
    struct.pack_into(
        ">I4xI4s4s4s", header, 0, start + len(body), 0x04400000, b"mntr", space, b"XYZ "
    )
    # A profile needs a date; this is the one of its standard.
    struct.pack_into(">6H4s", header, 24, 2022, 5, 1, 0, 0, 0, b"acsp")
    struct.pack_into(">3i", header, 68, *(round(65536 * one) for one in _D50))
    return bytes(header) + struct.pack(">I", len(tags)) + table + body
