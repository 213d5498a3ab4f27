"""The screens of an X server: what is plugged in, where it lies and what becomes of its pixels.

By RandR 1.5. What the server keeps is asked for, and no monitor is probed: that takes long.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.x11.connection import XConnection, XError
from drivers.x11.edid import Monitor, read_edid

_CHANGES = 1 | 2 | 4
"""Screen, CRTC and output changes."""

_UNSCALED = (0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x10000)
_UPRIGHT = 1
_DISCONNECTED = 1
_ANY = 0


@dataclass(frozen=True)
class Output:
    """A connector with a lit screen: x, y, width, height in pixels of the X screen.

    refresh: hertz, 0 where the server doesn't know. distortion: what the graphics card does
    to its pixels (scaling, turning), in words; empty if it sends them as they are. crtc:
    the server's number of the part that scans the picture out.
    """

    name: str
    monitor: Monitor
    x: int
    y: int
    width: int
    height: int
    refresh: float
    primary: bool
    distortion: str = ""
    number: int = 0
    crtc: int = 0

    @property
    def region(self) -> tuple[int, int, int, int]:
        return self.x, self.y, self.width, self.height

    def overlaps(self, other: Output) -> bool:
        """Whether some pixels are shown by both."""
        return (
            self.x < other.x + other.width
            and other.x < self.x + self.width
            and self.y < other.y + other.height
            and other.y < self.y + self.height
        )

    def __str__(self) -> str:
        who = ", ".join(filter(None, (self.monitor.model, self.monitor.serial)))
        words = f"{self.name}{f' ({who})' if who else ''} {self.width}x{self.height}"
        words += f" at {self.x},{self.y}, {self.refresh:.4g} Hz"
        return words + (", primary" if self.primary else "")


def list_outputs(x: XConnection) -> list[Output]:
    """The screens that are lit now, in the server's order. XError if it has no RandR."""
    x.query_extension("RANDR", 0, "II", 1, 5)
    root = x.setup.root
    told = x.query_extension("RANDR", 25, "I", root)
    _, stamp, crtcs, count, modes = struct.unpack_from("<IIHHH", told, 8)
    at = 32 + 4 * crtcs
    numbers = struct.unpack_from(f"<{count}I", told, at)
    rates = _parse_modes(told, at + 4 * count, modes)
    (primary,) = struct.unpack_from("<I", x.query_extension("RANDR", 31, "I", root), 8)
    edid = x.atom("EDID")
    found = (_read_output(x, number, stamp, rates, number == primary, edid) for number in numbers)
    lit = [output for output in found if output is not None]
    if lit and not any(output.primary for output in lit):
        # Where a desktop begins: the screen that it takes for its first.
        first = min(lit, key=lambda output: (output.x, output.y))
        return [replace(output, primary=output is first) for output in lit]
    return lit


def watch_changes(x: XConnection) -> None:
    """Have the server tell, as events, when screens come, go or change."""
    x.send_extension_request("RANDR", 4, "IHxx", x.setup.root, _CHANGES)


def has_been_lost(x: XConnection, output: Output) -> bool:
    """Whether a screen was dark or unplugged since this was asked, even if it is back.

    x: told by `watch_changes` to watch, and used for nothing else.
    """
    _, first = x.extension("RANDR")
    lost = False
    for event in x.events():
        if event[0] & 0x7F != first + 1:
            continue
        if event[1] == 0:
            crtc, mode = struct.unpack_from("<II", event, 12)
            lost |= crtc == output.crtc and not mode
        elif event[1] == 1:
            number, crtc = struct.unpack_from("<II", event, 16)
            gone = not crtc or event[30] == _DISCONNECTED
            lost |= number == output.number and gone
    return lost


def read_gamma_ramp(x: XConnection, crtc: int) -> NDArray[np.uint16]:
    """What the graphics card makes of grey levels: (3, n) of 0 to 65535; n is 0 without one."""
    told = x.query_extension("RANDR", 23, "I", crtc)
    (size,) = struct.unpack_from("<H", told, 8)
    return np.frombuffer(told, "<u2", 3 * size, 32).reshape(3, size).astype(np.uint16)


def _parse_modes(told: bytes, at: int, count: int) -> dict[int, tuple[int, int, float]]:
    """Width, height and refresh rate of each mode."""
    found = {}
    for _ in range(count):
        number, width, height, dots = struct.unpack_from("<IHHI", told, at)
        (columns,), (rows,) = (struct.unpack_from("<H", told, at + i) for i in (16, 24))
        (flags,) = struct.unpack_from("<I", told, at + 28)
        fields = 2.0 if flags & 0x10 else 1.0  # interlaced
        lines = rows * (2 if flags & 0x20 else 1)  # each shown twice
        found[number] = (width, height, fields * dots / max(1, columns * lines))
        at += 32
    return found


def _read_output(
    x: XConnection,
    number: int,
    stamp: int,
    modes: dict[int, tuple[int, int, float]],
    primary: bool,
    edid: int,
) -> Output | None:
    told = x.query_extension("RANDR", 9, "II", number, stamp)
    (crtc,) = struct.unpack_from("<I", told, 12)
    if not crtc or told[24] == _DISCONNECTED:
        return None
    crtcs, many, _, clones, length = struct.unpack_from("<HHHHH", told, 26)
    at = 36 + 4 * (crtcs + many + clones)
    name = told[at : at + length].decode("latin-1")
    seen = x.query_extension("RANDR", 20, "II", crtc, stamp)
    left, top, width, height, mode, turned = struct.unpack_from("<hhHHIH", seen, 12)
    if not mode:
        return None
    columns, rows, rate = modes.get(mode, (width, height, 0.0))
    distorted = _describe_distortion(x, crtc, (columns, rows), (width, height), turned)
    monitor = read_edid(_read_property(x, number, edid))
    return Output(name, monitor, left, top, width, height, rate, primary, distorted, number, crtc)


def _describe_distortion(
    x: XConnection, crtc: int, mode: tuple[int, int], size: tuple[int, int], rotation: int
) -> str:
    if rotation != _UPRIGHT:
        return "it is turned or mirrored"
    if mode != size:
        return f"{size[0]}x{size[1]} pixels are scaled to {mode[0]}x{mode[1]}"
    told = x.query_extension("RANDR", 27, "I", crtc)
    if struct.unpack_from("<9i", told, 48) != _UNSCALED:
        return "its pixels are scaled or shifted by a transform"
    return ""


def _read_property(x: XConnection, output: int, name: int) -> bytes:
    """An output's property; empty if it hasn't got it."""
    try:
        told = x.query_extension("RANDR", 15, "IIIIIBB2x", output, name, _ANY, 0, 128, 0, 0)
    except XError:
        return b""
    (count,) = struct.unpack_from("<I", told, 16)
    return told[32 : 32 + count * max(1, told[1] // 8)]
