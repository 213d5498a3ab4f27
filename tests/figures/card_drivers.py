"""What graphics cards' drivers tell X11 of a connector: properties, what they take, what is sound.

By the sources of Linux 6.1, drivers/gpu/drm: drm_connector.c, i915/display/intel_modes.c,
amd/amdgpu/amdgpu_display.c, radeon/radeon_display.c, nouveau/nouveau_display.c; and the X drivers
modesetting and amdgpu for CTM. What is sound is decided here by what the values are for, apart from
labapp's own list.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from figures.connector_properties import Value

_ONE, _ZERO = (0, 1), (0, 0)

IDENTITY = [*_ONE, *_ZERO * 3, *_ONE, *_ZERO * 3, *_ONE]


@dataclass(frozen=True)
class Property:
    """A property of a connector. valid: what it takes. sound, altering: values that leave grey
    levels as they are, and that don't; none of both are for what has nothing to do with them."""

    name: str
    valid: tuple[str | int, ...]
    sound: tuple[Value, ...] = ()
    altering: tuple[Value, ...] = ()
    is_range: bool = False


def _number(
    name: str, least: int, most: int, sound: tuple[int, ...], altering: tuple[int, ...]
) -> Property:
    values = (tuple((n,) for n in sound), tuple((n,) for n in altering))
    return Property(name, (least, most), *values, is_range=True)


def _words(name: str, valid: str, sound: str, altering: str) -> Property:
    plain, other = (tuple(filter(None, told.split("|"))) for told in (sound, altering))
    return Property(name, tuple(valid.split("|")), plain, other)


def _matrix(rng: np.random.Generator) -> tuple[int, ...]:
    """A colour matrix of a night light, or of more saturation: S31.32, the low half first."""
    warm = np.diag([1.0, *rng.uniform(0.3, 0.95, 2)])
    gain = rng.uniform(1.1, 1.9)
    vivid = gain * np.eye(3) + (1 - gain) / 3
    words: list[int] = []
    for number in (warm if rng.random() < 0.5 else vivid).ravel():
        whole = round(abs(float(number)) * (1 << 32)) | (number < 0) << 63
        words += [
            int(np.uint32(whole & 0xFFFFFFFF).astype(np.int32)),
            int(np.uint32(whole >> 32).astype(np.int32)),
        ]
    return tuple(words)


def _ctm(rng: np.random.Generator) -> Property:
    return Property("CTM", (), (tuple(IDENTITY),), tuple(_matrix(rng) for _ in range(3)))


_BPC = _number("max bpc", 6, 16, (8, 10, 12, 16), (6, 7))
_SCALING = _words("scaling mode", "None|Full|Center|Full aspect", "None|Center", "Full|Full aspect")
_UNDERSCAN = (
    _words("underscan", "off|on|auto", "off", "on|auto"),
    _number("underscan hborder", 0, 128, (0,), (1, 64, 128)),
    _number("underscan vborder", 0, 128, (0,), (1, 64, 128)),
)
_COLOURS = _words(
    "Colorspace",
    "Default|SMPTE_170M_YCC|BT709_YCC|XVYCC_709|SYCC_601|opRGB|BT2020_RGB|BT2020_YCC|DCI-P3_RGB_D65",
    "Default",
    "SMPTE_170M_YCC|BT709_YCC|opRGB|BT2020_RGB|BT2020_YCC|DCI-P3_RGB_D65",
)
_DITHER = _words("dither", "off|on", "off", "on")

ANY_DRIVER = (
    _words("audio", "force-dvi|off|auto|on", "", ""),
    _words("Content Protection", "Undesired|Desired|Enabled", "", ""),
    _number("CONNECTOR_ID", 0, 1000, (), ()),
)
"""What has nothing to do with levels, and what may change at any time."""


def card_driver(name: str, rng: np.random.Generator) -> tuple[Property, ...]:
    """The properties that a driver tells of a connector."""
    return {
        "i915": (
            _words(
                "Broadcast RGB", "Automatic|Full|Limited 16:235", "Full", "Limited 16:235|Automatic"
            ),
            _BPC,
            _COLOURS,
            _SCALING,
            _ctm(rng),
            _words(
                "content type",
                "No Data|Graphics|Photo|Cinema|Game",
                "No Data|Graphics",
                "Photo|Cinema",
            ),
        ),
        "amdgpu": (
            _BPC,
            _DITHER,
            *_UNDERSCAN,
            _SCALING,
            _COLOURS,
            _ctm(rng),
            _number("abm level", 0, 4, (0,), (1, 2, 3, 4)),
            _number("freesync", 0, 1, (0,), (1,)),
            _number("vrr_capable", 0, 1, (0, 1), ()),
        ),
        "radeon": (
            _words(
                "output_csc", "bypass|tvrgb|ycbcr601|ycbcr709", "bypass", "tvrgb|ycbcr601|ycbcr709"
            ),
            _DITHER,
            *_UNDERSCAN,
            _number("coherent", 0, 1, (0, 1), ()),
        ),
        "nouveau": (
            _words(
                "dithering mode",
                "auto|off|static 2x2|dynamic 2x2|temporal",
                "off",
                "static 2x2|dynamic 2x2|temporal",
            ),
            _words("dithering depth", "auto|6 bpc|8 bpc", "auto|8 bpc", "6 bpc"),
            *_UNDERSCAN,
            _SCALING,
            _number("vibrant hue", 0, 180, (90,), (0, 45, 91, 180)),
            _number("color vibrance", 0, 200, (150,), (0, 100, 140, 200)),
        ),
    }[name]


DRIVERS = ("i915", "amdgpu", "radeon", "nouveau")
