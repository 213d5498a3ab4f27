"""List the lit screens with their monitors, positions, sizes and distortions.

The RandR extension 1.5 is used. The server's stored state is read without probing the monitors,
which would take long.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from drivers.x11.connection import XConnection, XError
from drivers.x11.edid import Monitor, native_size, read_edid
from drivers.x11.output_properties import changed_properties, read_property


class _RandrRequest(IntEnum):
    """Minor opcodes of RandR's requests."""

    QUERY_VERSION = 0
    SELECT_INPUT = 4
    GET_OUTPUT_INFO = 9
    GET_CRTC_INFO = 20
    GET_CRTC_GAMMA = 23
    GET_SCREEN_RESOURCES_CURRENT = 25
    GET_CRTC_TRANSFORM = 27
    GET_PANNING = 28
    GET_OUTPUT_PRIMARY = 31


class _Connection(IntEnum):
    """Whether a monitor is connected to an output, as RandR has it."""

    CONNECTED = 0
    DISCONNECTED = 1


@dataclass(frozen=True)
class Output:
    """A connector with a lit screen.

    x, y, width, height: pixels of the X screen. refresh: hertz, 0 if the server doesn't know it.
    distortion: how the graphics card changes the pixels (scaling, rotation); empty if it doesn't.
    number, crtc: the server's numbers of the output and of the part that scans the picture out.
    native: columns and rows of the monitor itself; zeros if it doesn't tell them.
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
    native: tuple[int, int] = (0, 0)

    @property
    def region(self) -> tuple[int, int, int, int]:
        return self.x, self.y, self.width, self.height

    def overlaps(self, other: Output) -> bool:
        """Return whether both outputs show some of the same pixels."""
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


@dataclass(frozen=True)
class OutputChanges:
    """What was reported of an output since the last look.

    lost: whether it was dark or unplugged, even if it is back. properties: atoms of the properties
    that were set.
    """

    lost: bool
    properties: frozenset[int]


def list_outputs(x: XConnection) -> list[Output]:
    """List the lit screens in the server's order; XError if it lacks RandR."""
    x.query_extension("RANDR", _RandrRequest.QUERY_VERSION, "II", 1, 5)
    root = x.setup.root
    told = x.query_extension("RANDR", _RandrRequest.GET_SCREEN_RESOURCES_CURRENT, "I", root)
    _, stamp, crtcs, count, modes = struct.unpack_from("<IIHHH", told, 8)
    at = 32 + 4 * crtcs
    numbers = struct.unpack_from(f"<{count}I", told, at)
    rates = _parse_modes(told, at + 4 * count, modes)
    answer = x.query_extension("RANDR", _RandrRequest.GET_OUTPUT_PRIMARY, "I", root)
    (primary,) = struct.unpack_from("<I", answer, 8)
    edid = x.atom("EDID")
    found = (_read_output(x, number, stamp, rates, number == primary, edid) for number in numbers)
    lit = [output for output in found if output is not None]
    if lit and not any(output.primary for output in lit):
        # Without a primary screen, desktops use the top left one as their first.
        first = min(lit, key=lambda output: (output.x, output.y))
        return [replace(output, primary=output is first) for output in lit]
    return lit


def watch_changes(x: XConnection) -> None:
    """Ask for events when screens or their properties change, or are plugged."""
    screen_crtc_output_and_property_changes = 1 | 2 | 4 | 8
    x.send_extension_request(
        "RANDR",
        _RandrRequest.SELECT_INPUT,
        "IHxx",
        x.setup.root,
        screen_crtc_output_and_property_changes,
    )


def read_changes(x: XConnection, output: Output) -> OutputChanges:
    """Return what was reported of an output since the last call.

    x: a connection on which `watch_changes` was called, and which nothing else uses.
    """
    _, first = x.extension("RANDR")
    lost, properties = False, set[int]()
    for event in x.events():
        properties.update(changed_properties(x, output.number, event))
        if event[0] & 0x7F != first + 1:
            continue
        if event[1] == 0:
            crtc, mode = struct.unpack_from("<II", event, 12)
            lost |= crtc == output.crtc and not mode
        elif event[1] == 1:
            number, crtc = struct.unpack_from("<II", event, 16)
            gone = not crtc or event[30] == _Connection.DISCONNECTED
            lost |= number == output.number and gone
    return OutputChanges(lost, frozenset(properties))


def read_gamma_ramp(x: XConnection, crtc: int) -> NDArray[np.uint16]:
    """Read the graphics card's gamma ramp: (3, n) of 0 to 65535; n is 0 without one."""
    told = x.query_extension("RANDR", _RandrRequest.GET_CRTC_GAMMA, "I", crtc)
    (size,) = struct.unpack_from("<H", told, 8)
    return np.frombuffer(told, "<u2", 3 * size, 32).reshape(3, size).astype(np.uint16)


def _parse_modes(told: bytes, at: int, count: int) -> dict[int, tuple[int, int, float]]:
    """Decode RandR's modes: width, height and refresh rate (hertz) of each, by its number."""
    found = {}
    for _ in range(count):
        number, width, height, dots = struct.unpack_from("<IHHI", told, at)
        (columns,), (rows,) = (struct.unpack_from("<H", told, at + i) for i in (16, 24))
        (flags,) = struct.unpack_from("<I", told, at + 28)
        # Flag 0x10 is an interlaced mode, with two fields per frame.
        fields = 2.0 if flags & 0x10 else 1.0
        # Flag 0x20 is double scan, which shows each line twice.
        lines = rows * (2 if flags & 0x20 else 1)
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
    """Read an output's screen; None if it isn't lit."""
    told = x.query_extension("RANDR", _RandrRequest.GET_OUTPUT_INFO, "II", number, stamp)
    (crtc,) = struct.unpack_from("<I", told, 12)
    if not crtc or told[24] == _Connection.DISCONNECTED:
        return None
    crtcs, many, _, clones, length = struct.unpack_from("<HHHHH", told, 26)
    at = 36 + 4 * (crtcs + many + clones)
    name = told[at : at + length].decode("latin-1")
    seen = x.query_extension("RANDR", _RandrRequest.GET_CRTC_INFO, "II", crtc, stamp)
    left, top, width, height, mode, turned = struct.unpack_from("<hhHHIH", seen, 12)
    if not mode:
        return None
    columns, rows, rate = modes.get(mode, (width, height, 0.0))
    distorted = _describe_distortion(x, crtc, (columns, rows), (width, height), turned)
    told = _read_edid(x, number, edid)
    monitor, native = read_edid(told), native_size(told)
    return Output(
        name, monitor, left, top, width, height, rate, primary, distorted, number, crtc, native
    )


def _describe_distortion(
    x: XConnection, crtc: int, mode: tuple[int, int], size: tuple[int, int], rotation: int
) -> str:
    """Describe how the pixels are scaled or turned on the way out; empty if they aren't."""
    upright = 1
    if rotation != upright:
        return "it is turned or mirrored"
    told = x.query_extension("RANDR", _RandrRequest.GET_PANNING, "I", crtc)
    panned = struct.unpack_from("<HH", told, 16)
    if all(panned) and panned != mode:
        shown = f"{mode[0]}x{mode[1]} of {panned[0]}x{panned[1]} pixels"
        return f"only {shown} are seen, which move with the pointer (panning)"
    if mode != size:
        return f"{size[0]}x{size[1]} pixels are scaled to {mode[0]}x{mode[1]}"
    told = x.query_extension("RANDR", _RandrRequest.GET_CRTC_TRANSFORM, "I", crtc)
    # RandR gives the matrix row by row, in fixed point with 16 binary places.
    identity = (0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x10000)
    if struct.unpack_from("<9i", told, 48) != identity:
        return "its pixels are scaled or shifted by a transform"
    return ""


def _read_edid(x: XConnection, output: int, name: int) -> bytes:
    """Read the EDID of an output's monitor; empty if it has none."""
    try:
        return read_property(x, output, name)[2]
    except XError:
        return b""
