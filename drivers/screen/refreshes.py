"""Receive the times of refreshes from the X server's Present extension.

A graphics card's driver counts the real refreshes of a screen. For a virtual screen, the server
generates them by its own clock.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

from drivers.x11 import XConnection
from drivers.x11.libxcb import GENERIC_EVENT


class _PresentRequest(IntEnum):
    """Minor opcodes of the Present extension's requests."""

    QUERY_VERSION = 0
    NOTIFY_MSC = 2
    SELECT_INPUT = 3


class _PresentEvent(IntEnum):
    """Types of the Present extension's events."""

    COMPLETE_NOTIFY = 1


class _CompleteKind(IntEnum):
    """What a CompleteNotify event of the Present extension reports."""

    NOTIFY_MSC = 1


class Refresh(NamedTuple):
    """A refresh: the X server's count, and time.monotonic() in seconds."""

    number: int
    time: float


class RefreshEvents:
    """Receive refresh events through a separate X connection, so that nothing else reads them."""

    def __init__(self, display: str, window: int) -> None:
        """Connect to the X server; XError if it doesn't report refreshes."""
        self.x = XConnection(display)
        try:
            self.x.query_extension("Present", _PresentRequest.QUERY_VERSION, "II", 1, 0)
            self._major, _ = self.x.extension("Present")
            self._window = window
            self.x.send_extension_request(
                "Present",
                _PresentRequest.SELECT_INPUT,
                "III",
                self.x.new_id(),
                window,
                1 << _PresentEvent.COMPLETE_NOTIFY,
            )
        except BaseException:
            self.x.close()
            raise
        self._serial = 0

    def request_refresh(self, number: int) -> None:
        """Request an event for refresh `number`.

        If that refresh has passed, the event is for the latest one. Earlier requests are ignored
        from now on.
        """
        self._serial = (self._serial + 1) & 0xFFFFFFFF
        layout = "II4xQQQ"
        self.x.send_extension_request(
            "Present",
            _PresentRequest.NOTIFY_MSC,
            layout,
            self._window,
            self._serial,
            number,
            0,
            0,
        )

    def poll_refresh(self) -> Refresh | None:
        """Return the requested refresh, if its event has arrived."""
        found = None
        for event in self.x.events():
            if len(event) < 44 or event[0] & 0x7F != GENERIC_EVENT or event[1] != self._major:
                continue
            kind, sort = struct.unpack_from("<HB", event, 8)
            (serial, microseconds) = struct.unpack_from("<IQ", event, 20)
            wanted = kind == _PresentEvent.COMPLETE_NOTIFY and sort == _CompleteKind.NOTIFY_MSC
            if wanted and serial == self._serial:
                # libxcb inserts four bytes of its own after the first 32.
                (number,) = struct.unpack_from("<Q", event, 36)
                found = Refresh(number, microseconds * 1e-6)
        return found

    def close(self) -> None:
        self.x.close()
