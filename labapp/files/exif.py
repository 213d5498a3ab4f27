"""What a camera notes beside a picture: exposure, aperture, sensitivity, orientation (Exif 3.0).

A block of Exif is a small TIFF file without a picture (CIPA DC-008-2023, section 4.5). TIFF files
have the same directories, so that they're read here, too. Only the tags that matter are looked at,
and none of them may hold more than a line, so that a damaged block costs nothing: what can't be
read is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime

from labapp.files.tiff_directories import Directory, read_directory

_MOST_VALUES = 256
"""Values of a tag, or bytes of its text, that are read. Chosen."""

_MOST_APEX = 40.0
"""Highest magnitude of an APEX value: 2^40 s are longer than any exposure. Chosen."""

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

SRGB, UNCALIBRATED = 1, 0xFFFF
"""Exif's numbers of colour spaces (section 4.6.4)."""


@dataclass(frozen=True)
class Exif:
    """What a camera noted beside a picture; each is None or empty where it didn't.

    exposure_time: s.
    f_number: focal length over diameter.
    iso: sensitivity.
    exposure_bias: EV by which the camera was told to expose more than it measured.
    orientation: 1 to 8, as Exif counts them; 1 is upright.
    colour_space: Exif's number, 1 for sRGB, 65535 for another one.
    maker, model: the camera's.
    taken: the camera's clock when it took the picture, without a time zone.
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


def read_exif(data: bytes, directory: int | None = None) -> Exif | None:
    """Return what a block of Exif or a TIFF says of a picture; None if it isn't readable.

    directory: place in the bytes of the TIFF directory to read; by default the first one.
    """
    data = data[6:] if data[:6] in (b"Exif\0\0", b"Exif\0\xff") else data
    first = read_directory(data, directory)
    if first is None:
        return None
    inner = first.sub_directory(_EXIF_DIRECTORY)
    found = _interpret(_Tags(first if inner is None else inner, first))
    return None if found == Exif() else found


@dataclass(frozen=True, eq=False)
class _Tags:
    """The tags of a directory of Exif, or else of the outer one that leads to it."""

    own: Directory
    outer: Directory

    def number(self, tag: int) -> float | None:
        """Return a tag's first number; None where it is missing, a text, or not finite."""
        for place in (self.own, self.outer):
            if found := place.numbers(tag, _MOST_VALUES):
                is_sound = not place.is_text(tag) and math.isfinite(found[0])
                return float(found[0]) if is_sound else None
        return None

    def positive(self, tag: int) -> float | None:
        """Return a tag's first number if it is above 0."""
        value = self.number(tag)
        return value if value is not None and value > 0 else None

    def text(self, tag: int) -> str:
        """Return a tag's text; empty if it is missing or no text."""
        return self.own.text(tag, _MOST_VALUES) or self.outer.text(tag, _MOST_VALUES)


def _interpret(tags: _Tags) -> Exif:
    """Return what the tags of a picture say."""
    orientation = tags.number(_ORIENTATION)
    space = tags.number(_COLOUR_SPACE)
    stated = (tags.positive(tag) for tag in _SENSITIVITIES)
    return Exif(
        tags.positive(_EXPOSURE_TIME) or _power_of_two(tags, _SHUTTER_SPEED, -1.0),
        tags.positive(_F_NUMBER) or _power_of_two(tags, _APERTURE, 0.5),
        next((one for one in stated if one and one != _SENSITIVITY_ELSEWHERE), None),
        tags.number(_BIAS),
        int(orientation) if orientation is not None and orientation in range(1, 9) else None,
        None if space is None else int(space),
        tags.text(_MAKER),
        tags.text(_MODEL),
        _time_taken(tags),
    )


def _power_of_two(tags: _Tags, tag: int, factor: float) -> float | None:
    """Return 2 to the power of an APEX value times a factor (Exif 3.0, annex C).

    The time is 2^-Tv seconds, and the f-number 2^(Av/2).
    """
    value = tags.number(tag)
    return None if value is None or abs(value) > _MOST_APEX else 2.0 ** (factor * value)


def _time_taken(tags: _Tags) -> datetime | None:
    """Return when the picture was taken, digitised or changed, by the first that is stated."""
    for date, fraction in _DATES:
        digits = tags.text(fraction)
        digits = digits[:6] if digits.isascii() and digits.isdigit() else "0"
        try:
            return datetime.strptime(f"{tags.text(date)}.{digits}", "%Y:%m:%d %H:%M:%S.%f")
        except ValueError:
            continue
    return None
