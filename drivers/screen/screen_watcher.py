"""Look whether the SLM is connected, without the window and without disturbing it."""

from __future__ import annotations

import os
import threading

from drivers.errors import DeviceError
from drivers.screen.screen_choice import ScreenRequest, choose_screen
from drivers.x11 import XConnection, XError
from drivers.x11.outputs import list_outputs, watch_changes


class ScreenWatcher:
    """Look for the SLM through a separate X connection, opened at the first call.

    The X server reports when screens are plugged in or out, and only then are they listed again.

    request: which screen. display: as in DISPLAY; that of the environment if None.
    """

    def __init__(self, request: ScreenRequest, display: str | None) -> None:
        self._wanted, self._display = request, display
        self._turn = threading.Lock()
        self._x: XConnection | None = None
        self._reason = ""

    def unplugged_reason(self) -> str:
        """Return why the SLM is missing, empty if it isn't; takes 4 s at most."""
        with self._turn:
            try:
                self._update()
            except XError as error:
                self._close()
                return str(error)
            return self._reason

    def close(self) -> None:
        with self._turn:
            self._close()

    def _update(self) -> None:
        changed = self._x is None
        if self._x is None:
            self._x = XConnection(self._display or os.environ.get("DISPLAY", ""))
            watch_changes(self._x)
        for _ in self._x.events():
            changed = True
        if changed or self._reason:
            self._reason = self._missing_reason(self._x)

    def _missing_reason(self, x: XConnection) -> str:
        try:
            choose_screen(self._wanted, list_outputs(x))
        except DeviceError as error:
            return error.reply
        return ""

    def _close(self) -> None:
        x, self._x = self._x, None
        self._reason = ""
        if x is not None:
            x.close()
