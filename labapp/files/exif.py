"""What a camera notes beside a picture: exposure, aperture, sensitivity, orientation (Exif 3.0).

A block of Exif is a small TIFF file without a picture (CIPA DC-008-2023, section 4.5). TIFF files
have the same directories, so that they're read here, too. Only the tags that matter are looked at,
and none of them may hold more than a line, so that a damaged block costs nothing: what can't be
read is left out.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from datetime import datetime

Values = str | tuple[float, ...]
Tags = dict[int, Values]

_MOST_ENTRIES = 4096
"""Entries of a directory; cameras write some dozens. Chosen."""

_MOST_VALUES = 256
"""Values of a tag, or bytes of its text, that are read. Chosen."""

_MOST_APEX = 40.0
"""Highest magnitude of an APEX value: 2^40 s are longer than any exposure. Chosen."""

_CLASSIC = (42, 0x55, 0x4F52, 0x5352)
"""Versions of TIFF (TIFF 6.0, section 2), and of Panasonic's and Olympus' RAW, which differ from it
in this number only."""

_BYTE_ORDERS = {b"II": "<", b"MM": ">"}
_TEXT, _RATIONALS = 2, (5, 10)
_TYPES = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 6: "b", 7: "B", 8: "h", 9: "i", 10: "ii"}
_TYPES |= {11: "f", 12: "d", 13: "I", 16: "Q", 17: "q", 18: "Q"}
"""Types of a tag's values (TIFF 6.0, section 2; BigTIFF adds 16 to 18), as `struct` writes them."""

_MAKER, _MODEL, _ORIENTATION, _CHANGED = 0x010F, 0x0110, 0x0112, 0x0132
_EXIF_DIRECTORY = 0x8769
_EXPOSURE_TIME, _F_NUMBER, _SHUTTER_SPEED, _APERTURE, _BIAS = 0x829A, 0x829D, 0x9201, 0x9202, 0x9204
_DATES = ((0x9003, 0x9291), (0x9004, 0x9292), (_CHANGED, 0x9290))
"""Tags of the time when a picture was taken, digitised or changed, each with its sub-seconds."""

_SENSITIVITIES = (0x8827, 0x8833, 0x8832, 0x8831, 0xA215)
"""Tags of the sensitivity, the most common first: PhotographicSensitivity, ISOSpeed,
RecommendedExposureIndex, StandardOutputSensitivity (Exif 3.0, section 4.6.5), ExposureIndex."""

_SENSITIVITY_ELSEWHERE = 65535
"""PhotographicSensitivity where it has no more bits: another tag has the number."""

_COLOUR_SPACE = 0xA001
_WANTED = {
    *(_MAKER, _MODEL, _ORIENTATION, _EXIF_DIRECTORY, _EXPOSURE_TIME, _F_NUMBER, _SHUTTER_SPEED),
    *(_APERTURE, _BIAS, _COLOUR_SPACE, *_SENSITIVITIES, *(tag for pair in _DATES for tag in pair)),
}

SRGB, UNCALIBRATED = 1, 0xFFFF
"""Exif's numbers of colour spaces (section 4.6.4)."""


@dataclass(frozen=True)
class Exif:
    """What a camera noted beside a picture; each is None or empty where it didn't.

    exposure_time: s. f_number: focal length over diameter. iso: sensitivity. exposure_bias: EV by
    which the camera was told to expose more than it measured. orientation: 1 to 8, as Exif counts
    them; 1 is upright. colour_space: Exif's number, 1 for sRGB, 65535 for another one. maker and
    model: the camera's. taken: its clock when it took the picture, without a time zone.
    """

    exposure_time: float | None = None
    f_number: float | None = None
    iso: float | None = None
    exposure_bias: float | None = None
    orientation: int | None = None
    colour_space: int | None = None
    maker: str = ""
    model: str = ""
    taken: datetime | None = None


@dataclass(frozen=True)
class _Layout:
    """How TIFF or BigTIFF lays out a directory: byte order, types of counts and places."""

    order: str
    entries: str
    offset: str
    width: int


def read_exif(data: bytes, directory: int | None = None) -> Exif | None:
    """Return what a block of Exif or a TIFF file says of a picture; None if it isn't readable.

    directory: place in the bytes of the TIFF directory to read; by default the first one.
    """
    data = data[6:] if data[:6] in (b"Exif\0\0", b"Exif\0\xff") else data
    try:
        layout, first = _read_header(data)
    except (struct.error, KeyError):
        return None
    tags = _read_directory(data, layout, first if directory is None else directory)
    pointer = _number(tags, _EXIF_DIRECTORY)
    inner = _read_directory(data, layout, int(pointer)) if pointer else {}
    found = _interpret({**tags, **inner})
    return None if found == Exif() else found


def _read_header(data: bytes) -> tuple[_Layout, int]:
    """Return the layout of a TIFF structure, and the place of its first directory."""
    order = _BYTE_ORDERS[bytes(data[:2])]
    (version,) = struct.unpack_from(order + "H", data, 2)
    classic = dict.fromkeys(_CLASSIC, _Layout(order, "H", "I", 4))
    layout = {**classic, 43: _Layout(order, "Q", "Q", 8)}[version]
    (first,) = struct.unpack_from(order + layout.offset, data, layout.width)
    return layout, first


def _read_directory(data: bytes, layout: _Layout, at: int) -> Tags:
    """Return the wanted tags of a directory, as far as it can be read."""
    found: Tags = {}
    try:
        (count,) = struct.unpack_from(layout.order + layout.entries, data, at)
        at += struct.calcsize(layout.order + layout.entries)
        for _ in range(min(count, _MOST_ENTRIES)):
            tag, kind, number = struct.unpack_from(f"{layout.order}HH{layout.offset}", data, at)
            if tag in _WANTED and tag not in found and kind in _TYPES:
                values = _read_values(data, layout, at + 4 + layout.width, kind, number)
                found.update({} if values is None else {tag: values})
            at += 4 + 2 * layout.width
    except (struct.error, OverflowError):
        pass
    return found


def _read_values(data: bytes, layout: _Layout, field: int, kind: int, number: int) -> Values | None:
    """Return the values of a tag whose field of values or of their place is at `field`."""
    form = layout.order + _TYPES[kind]
    size = struct.calcsize(form) * number
    try:
        if size > layout.width:
            (field,) = struct.unpack_from(layout.order + layout.offset, data, field)
        if not number or field + size > len(data):
            return None
        number = min(number, _MOST_VALUES)
        if kind == _TEXT:
            text = bytes(data[field : field + number]).partition(b"\0")[0]
            return text.decode("utf-8", "replace").strip()
        found = struct.unpack_from(layout.order + number * _TYPES[kind], data, field)
    except (struct.error, OverflowError):
        return None
    if kind not in _RATIONALS:
        return tuple(float(one) for one in found)
    pairs = zip(found[::2], found[1::2], strict=True)
    return tuple(top / below if below else math.nan for top, below in pairs)


def _number(tags: Tags, tag: int) -> float | None:
    """Return a tag's first number; None where it is missing, a text, or not finite."""
    values = tags.get(tag, ())
    if not values or isinstance(values, str) or not math.isfinite(values[0]):
        return None
    return values[0]


def _positive(tags: Tags, tag: int) -> float | None:
    """Return a tag's first number if it is above 0."""
    value = _number(tags, tag)
    return value if value is not None and value > 0 else None


def _text(tags: Tags, tag: int) -> str:
    """Return a tag's text; empty if it is missing or no text."""
    value = tags.get(tag, "")
    return value if isinstance(value, str) else ""


def _interpret(tags: Tags) -> Exif:
    """Return what the tags of a picture say."""
    orientation = _number(tags, _ORIENTATION)
    space = _number(tags, _COLOUR_SPACE)
    return Exif(
        _positive(tags, _EXPOSURE_TIME) or _power_of_two(tags, _SHUTTER_SPEED, -1.0),
        _positive(tags, _F_NUMBER) or _power_of_two(tags, _APERTURE, 0.5),
        _sensitivity(tags),
        _number(tags, _BIAS),
        int(orientation) if orientation is not None and orientation in range(1, 9) else None,
        None if space is None else int(space),
        _text(tags, _MAKER),
        _text(tags, _MODEL),
        _time_taken(tags),
    )


def _power_of_two(tags: Tags, tag: int, factor: float) -> float | None:
    """Return 2 to the power of an APEX value times a factor (Exif 3.0, annex C).

    The time is 2^-Tv seconds, and the f-number 2^(Av/2).
    """
    value = _number(tags, tag)
    return None if value is None or abs(value) > _MOST_APEX else 2.0 ** (factor * value)


def _sensitivity(tags: Tags) -> float | None:
    """Return the sensitivity from the first tag that states one."""
    stated = (_positive(tags, tag) for tag in _SENSITIVITIES)
    return next((one for one in stated if one and one != _SENSITIVITY_ELSEWHERE), None)


def _time_taken(tags: Tags) -> datetime | None:
    """Return when the picture was taken, digitised or changed, by the first that is stated."""
    for date, fraction in _DATES:
        digits = _text(tags, fraction)
        digits = digits[:6] if digits.isascii() and digits.isdigit() else "0"
        try:
            return datetime.strptime(f"{_text(tags, date)}.{digits}", "%Y:%m:%d %H:%M:%S.%f")
        except ValueError:
            continue
    return None
