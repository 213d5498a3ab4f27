"""Which properties of a connector alter grey levels, by what the graphics drivers' sources say."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from drivers.screen.signal_rules import is_plain, rule_of
from drivers.x11.edid import native_size
from drivers.x11.output_properties import OutputProperty, parse_integers
from drivers.x11.power import is_switched_off, switch_on

RANGE = {"is_range": True}

IDENTITY = (0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1)
"""drm_color_ctm: nine numbers of 64 bits, the low half first, with 32 binary places."""

MINUS_ZERO = (0, 1, 0, -(1 << 31), *IDENTITY[4:])

BROADCAST = ("Automatic", "Full", "Limited 16:235")
DITHERING = ("auto", "off", "static 2x2", "dynamic 2x2", "temporal")
UNDERSCAN = ("off", "on", "auto")
SCALING = ("None", "Full", "Center", "Full aspect")
COLOURS = ("Default", "SMPTE_170M_YCC", "BT709_YCC", "opRGB", "BT2020_RGB", "DCI-P3_RGB_D65")


def line(size: int, columns: int) -> tuple[int, ...]:
    """A straight line as a lookup table of drm_color_lut, or of three colours."""
    levels = np.round(np.linspace(0, 65535, size)).astype(int)
    table = np.zeros((size, columns), int)
    table[:, :3] = levels[:, None]
    return tuple(map(int, table.ravel()))


@pytest.mark.parametrize(
    ("name", "valid", "kind", "plain", "altering", "wanted"),
    [
        ("Broadcast RGB", BROADCAST, {}, ["Full"], ["Automatic", "Limited 16:235"], "Full"),
        ("hdmi_quant_range", ("default", "limit", "full"), {}, ["full"], ["limit"], "full"),
        (
            "output_csc",
            ("bypass", "tvrgb", "ycbcr601", "ycbcr709"),
            {},
            ["bypass"],
            ["tvrgb", "ycbcr709"],
            "bypass",
        ),
        ("color_format", ("auto", "rgb", "ycbcr444"), {}, ["rgb"], ["ycbcr444"], "rgb"),
        ("max bpc", (6, 16), RANGE, [(8,), (10,), (16,)], [(6,), (7,)], (8,)),
        ("max bpc", (6, 7), RANGE, [], [(6,), (7,)], None),
        ("dither", ("off", "on"), {}, ["off"], ["on"], "off"),
        ("dithering mode", DITHERING, {}, ["off"], ["static 2x2", "temporal"], "off"),
        ("dithering depth", ("auto", "6 bpc", "8 bpc"), {}, ["auto", "8 bpc"], ["6 bpc"], "8 bpc"),
        ("underscan", UNDERSCAN, {}, ["off"], ["on", "auto"], "off"),
        ("underscan hborder", (0, 128), RANGE, [(0,)], [(1,), (32,)], (0,)),
        ("left margin", (0, 100), RANGE, [(0,)], [(7,)], (0,)),
        ("Border", (0, 65535), RANGE, [(0, 0, 0, 0)], [(0, 0, 0, 9)], (0, 0, 0, 0)),
        ("scaling mode", SCALING, {}, ["None", "Center"], ["Full", "Full aspect"], "None"),
        ("scaling mode", SCALING[1:], {}, ["Center"], ["Full aspect"], "Center"),
        ("Colorspace", COLOURS, {}, ["Default"], ["BT2020_RGB", "SMPTE_170M_YCC"], "Default"),
        ("CTM", (), {}, [IDENTITY, MINUS_ZERO, (0,) * 18, ()], [(*IDENTITY[:17], 0)], IDENTITY),
        (
            "CscMatrix",
            (),
            {},
            [(65536, 0, 0, 0, 0, 65536, 0, 0, 0, 0, 65536, 0)],
            [(65536, 0, 0, 0, 0, 65000, 0, 0, 0, 0, 65536, 0)],
            (65536, 0, 0, 0, 0, 65536, 0, 0, 0, 0, 65536, 0),
        ),
        (
            "color matrix",
            (),
            {},
            [(4096, 0, 0, 0, 4096, 0, 0, 0, 4096)],
            [(4096, 0, 0, 0, 4000, 0, 0, 0, 4096), (0, 1, 0, 1, 0, 0, 0, 0, 1), (1, 2)],
            None,
        ),
        ("GAMMA_LUT", (), {}, [line(256, 4), line(1024, 3)], [line(256, 4)[::-1]], None),
        ("GAMMA_LUT_SIZE", (), {}, [(256,), (4096,)], [], None),
        ("color vibrance", (0, 200), RANGE, [(150,)], [(100,), (160,)], (150,)),
        ("vibrant hue", (0, 180), RANGE, [(90,)], [(0,), (91,)], (90,)),
        ("DigitalVibrance", (-1024, 1023), RANGE, [(0,), (-1,)], [(500,)], (0,)),
        ("saturation", (0, 100), RANGE, [(50,)], [(0,), (80,)], (50,)),
        ("saturation", (0, 50, 100), {}, [(50,)], [(100,)], (50,)),
        ("contrast", (), {}, [(0,)], [(120,)], None),
        ("hue", (), {}, [], ["more"], None),
        ("Broadcast RGB", (), {}, ["full"], ["limited", (2,)], None),
        ("abm level", (0, 4), RANGE, [(0,)], [(1,), (4,)], (0,)),
        ("freesync", (0, 1), {}, [(0,)], [(1,)], (0,)),
        ("vrr_capable", (0, 1), {}, [(0,), (1,)], [], None),
        ("content type", ("No Data", "Graphics", "Photo"), {}, ["No Data"], ["Photo"], "Graphics"),
        ("link-status", ("Good", "Bad"), {}, ["Good"], ["Bad"], "Good"),
    ],
)
def test_what_alters_levels_is_known_and_what_leaves_them(
    name, valid, kind, plain, altering, wanted
):
    rule = rule_of(name)
    for value in plain:
        assert is_plain(OutputProperty(name, value, valid, **kind), rule), value
    for value in altering:
        given = OutputProperty(name, value, valid, **kind)
        assert not is_plain(given, rule), value
        assert rule.plain_value(given) == wanted


@pytest.mark.parametrize(
    "name",
    [
        *("EDID", "non-desktop", "Backlight", "WIDTH_MM", "audio", "TearFree", "GUID", "TILE"),
        *("Content Protection", "panel orientation", "ConnectorType", "aspect ratio"),
    ],
)
def test_what_does_nothing_to_levels_is_passed_over(name):
    assert rule_of(name) is None


def test_integers_are_read_in_every_width():
    assert parse_integers(b"\x00\x00\x00\x80\x07\x00\x00\x00", 32) == (-(1 << 31), 7)
    assert parse_integers(b"\xff\xff\x07\x00", 16) == (65535, 7)
    assert parse_integers(b"\xff\x07", 8) == (255, 7)
    assert parse_integers(b"", 0) == ()


def timing(columns: int, rows: int, *, flags: int = 0x1A) -> bytes:
    """A detailed timing descriptor by table 3.21 of VESA's E-EDID standard, release A2."""
    told = bytearray(18)
    told[:2] = (14850).to_bytes(2, "little")
    told[2], told[4] = columns & 255, columns >> 8 << 4
    told[5], told[7] = rows & 255, rows >> 8 << 4
    told[17] = flags
    return bytes(told)


@pytest.mark.parametrize(
    ("first", "features", "size"),
    [
        (timing(1920, 1080), 2, (1920, 1080)),
        (timing(1920, 540, flags=0x9A), 2, (1920, 1080)),
        (timing(1920, 1080), 0, (0, 0)),
        (bytes(18), 2, (0, 0)),
    ],
)
def test_a_monitors_own_size_is_read_from_its_edid(first, features, size):
    told = bytearray(128)
    told[:8] = bytes.fromhex("00ffffffffffff00")
    told[24], told[54:72] = features, first
    told[127] = -sum(told) % 256
    assert native_size(bytes(told)) == size
    told[100] ^= 1
    assert native_size(bytes(told)) == (0, 0)


class PowerServer:
    """An X server that saves power, by the document "DPMS Extension"; virtual ones never do."""

    def __init__(self, level: int, enabled: bool) -> None:
        self.level, self._enabled = level, enabled

    def has(self, name: str) -> bool:
        return name == "DPMS"

    def query_extension(self, name: str, minor: int) -> bytes:
        assert minor == 7  # DPMSInfo
        return struct.pack("<BxHIHB21x", 1, 1, 0, self.level, self._enabled)

    def send_extension_request(self, name: str, minor: int, layout: str, *values: int) -> None:
        assert (minor, struct.calcsize("<" + layout)) == (6, 4)  # DPMSForceLevel
        (self.level,) = values


@pytest.mark.parametrize(
    ("level", "enabled", "off"),
    [(0, True, False), (1, True, True), (3, True, True), (3, False, False)],
)
def test_a_screen_that_is_dark_to_save_power_is_switched_on(level, enabled, off):
    server = PowerServer(level, enabled)
    assert is_switched_off(server) is off
    switch_on(server)
    assert not is_switched_off(server)
