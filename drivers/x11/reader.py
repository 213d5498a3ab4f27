"""Read the pixels that a screen shows, from any process, without Qt or a window."""

from __future__ import annotations

import contextlib
import struct
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.x11.connection import XConnection, XError
from drivers.x11.shared_memory import XSharedMemory


class ScreenReader:
    """Read a rectangle of an X screen's pixels, from any process that may connect to it.

    The pixels are those in the server's memory: gamma ramps, scaling by the graphics card and
    faults of the cable aren't visible.

    Parameters
    ----------
    display : str
        The X server, as in DISPLAY.
    region : tuple of int, optional
        x, y, width and height in pixels; the whole screen by default.

    Raises
    ------
    XError
        If there is no server, the region isn't on the screen, or the screen doesn't have 8 bits
        per colour.
    """

    def __init__(self, display: str, region: tuple[int, int, int, int] | None = None) -> None:
        self._x = XConnection(display)
        self._memory: XSharedMemory | None = None
        self._damage, self._before = 0, False
        try:
            setup = self._x.setup
            self._region = region or (0, 0, *self._size())
            if (
                setup.masks != (0xFF0000, 0x00FF00, 0x0000FF)
                or not setup.little_endian
                or setup.bits_per_pixel[setup.depth] != 32
            ):
                raise XError(
                    f"{display} isn't a screen of 8 bits a colour (depth {setup.depth}, "
                    f"masks {', '.join(f'{m:06x}' for m in setup.masks)})"
                )
            self._require_inside()
            self._memory = self._attach_shared_memory()
            self._watch_damage()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection and the shared memory; may be called twice."""
        self._x.close()
        if self._memory is not None:
            self._memory.close()
            self._memory = None

    def colours(self) -> NDArray[np.uint8]:
        """Read the pixels now: (rows, columns, 3), red, green and blue."""
        return np.ascontiguousarray(self.pixels()[..., 2::-1])

    def grey(self) -> NDArray[np.uint8]:
        """Read the green values now, (rows, columns).

        Where the screen shows grey, red and blue are equal to green.
        """
        return np.ascontiguousarray(self.pixels()[..., 1])

    def pixels(self, top: int = 0, rows: int | None = None) -> NDArray[np.uint8]:
        """Read some rows now: (rows, columns, 4).

        The last axis is blue, green, red and padding. The array is valid until the next call.
        """
        x, y, width, height = self._region
        y, height = y + top, height - top if rows is None else rows
        if self._memory is not None:
            self._memory.fetch(x, y, width, height)
            return self._memory.bytes[: 4 * width * height].reshape(height, width, 4)
        whole, pixmap, root = 0xFFFFFFFF, 2, self._x.setup.root
        body = struct.pack("<BBHIhhHHI", 73, pixmap, 0, root, x, y, width, height, whole)
        pixels = np.frombuffer(self._x.query(73, body), np.uint8, 4 * width * height, 32)
        return pixels.reshape(height, width, 4)

    def has_changed(self) -> bool:
        """Return whether anything was drawn since the last call.

        The first call returns True. No change is missed: what is drawn between this call and
        reading the pixels is reported by the next call. Always True if the server lacks the
        DAMAGE extension.
        """
        if not self._damage:
            return True
        _, first = self._x.extension("DAMAGE")
        told = [event for event in self._x.events() if event[0] & 0x7F == first]
        if told:
            self._x.send_extension_request("DAMAGE", 3, "III", self._damage, 0, 0)
        before, self._before = self._before, True
        return bool(told) or not before

    def _size(self) -> tuple[int, int]:
        """Return the present columns and rows of the whole screen; they may change."""
        root = struct.pack("<BBHI", 14, 0, 0, self._x.setup.root)
        columns, rows = struct.unpack_from("<HH", self._x.query(14, root), 16)
        return columns, rows

    def _require_inside(self) -> None:
        x, y, width, height = self._region
        columns, rows = self._size()
        if min(x, y) < 0 or min(width, height) < 1 or x + width > columns or y + height > rows:
            raise XError(
                f"{width}x{height}+{x}+{y} isn't on the screen {self._x.display}, which has "
                f"{columns}x{rows} pixels"
            )

    def _watch_damage(self) -> None:
        if self._x.has("DAMAGE"):
            self._x.query_extension("DAMAGE", 0, "II", 1, 1)
            self._damage = self._x.new_id()
            # Level 3, "non-empty": one event is sent until the damage is subtracted.
            self._x.send_extension_request(
                "DAMAGE", 1, "IIB3x", self._damage, self._x.setup.root, 3
            )

    def _attach_shared_memory(self) -> XSharedMemory | None:
        """Share memory with a server on this machine, so that reading is ten times as fast.

        The result is None if the server can't access the memory.
        """
        with contextlib.suppress(XError):
            return XSharedMemory(self._x, 4 * self._region[2] * self._region[3])
        return None
