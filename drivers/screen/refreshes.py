"""When the screen is refreshed, as the X server tells: the Present extension.

A graphics card's driver counts the real refreshes of the screen; where there is no such
screen, the server makes them up by its own clock.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from drivers.x11 import XConnection

_COMPLETE = 1 << 1
_COMPLETED, _NOTIFY = 1, 1
_GENERIC = 35


class Refresh(NamedTuple):
    """number: counted by the server. time: seconds of time.monotonic()."""

    number: int
    time: float


class RefreshEvents:
    """A connection of its own, for events only: nothing else may take them off its socket."""

    def __init__(self, display: str, window: int) -> None:
        """XError if the server can't tell."""
        self.x = XConnection(display)
        try:
            self.x.query_extension("Present", 0, "II", 1, 0)
            self._major, _ = self.x.extension("Present")
            self._window = window
            self.x.send_extension_request("Present", 3, "III", self.x.new_id(), window, _COMPLETE)
        except BaseException:
            self.x.close()
            raise
        self._serial = 0

    def request_refresh(self, number: int) -> None:
        """Have refresh `number` told, or the latest if it has been. Earlier wishes are void."""
        self._serial = (self._serial + 1) & 0xFFFFFFFF
        layout = "II4xQQQ"
        self.x.send_extension_request(
            "Present", 2, layout, self._window, self._serial, number, 0, 0
        )

    def poll_refresh(self) -> Refresh | None:
        """The refresh that was asked for, if it has been."""
        found = None
        for event in self.x.events():
            if len(event) < 44 or event[0] & 0x7F != _GENERIC or event[1] != self._major:
                continue
            kind, sort = struct.unpack_from("<HB", event, 8)
            (serial, microseconds) = struct.unpack_from("<IQ", event, 20)
            if kind == _COMPLETED and sort == _NOTIFY and serial == self._serial:
                # libxcb puts four bytes of its own behind the first 32.
                (number,) = struct.unpack_from("<Q", event, 36)
                found = Refresh(number, microseconds * 1e-6)
        return found

    def close(self) -> None:
        self.x.close()
