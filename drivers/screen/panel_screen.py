"""Cover the SLM with a window, read it back, and follow its plugging in and out."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.screen.display_checks import readback_error
from drivers.screen.screen_choice import ScreenRequest, choose_screen
from drivers.screen.session import connect_display
from drivers.screen.signal_path import SignalPath
from drivers.x11 import ScreenReader, XConnection, XError
from drivers.x11.outputs import Output, list_outputs, read_changes, watch_changes

if TYPE_CHECKING:
    from PySide6.QtGui import QImage

    from drivers.screen.canvas import Canvas

_CHECKED_BANDS = 4
"""Bands into which a video's frames are divided; each check reads one band. Chosen."""

_RESYNC = 2.0
"""Seconds for which a panel may be dark after its signal was changed. Chosen."""


class PanelScreen:
    """Show pictures on the SLM and read them back.

    model: the device's name in errors. display: as in DISPLAY; that of the environment if None.
    """

    def __init__(
        self, model: str, request: ScreenRequest, display: str | None, allow_ramp: bool
    ) -> None:
        self._model, self._wanted = model, request
        self._canvas: Canvas | None = None
        self._reader: ScreenReader | None = None
        self._band = 0
        self._lost = False
        self.dark_until = 0.0
        self._verified: tuple[NDArray[np.uint8], NDArray[np.uint32]]
        self.x = connect_display(model, display)
        self.output = choose_screen(request, list_outputs(self.x))
        self.signal = SignalPath(model, self.x, self.output, allow_ramp, request.allowed)
        self.changes = XConnection(self.x.display)
        watch_changes(self.changes)
        # Suspend the screen saver while connected. Without the extension there is none.
        if self.x.has("MIT-SCREEN-SAVER"):
            self.x.send_extension_request("MIT-SCREEN-SAVER", 5, "I", 1)
        from drivers.screen.canvas import qt_application

        qt_application(self.x.display)
        self.neutral = np.zeros((request.height, request.width), np.uint8)
        try:
            self._cover()
        except BaseException:
            self.close()
            raise

    @property
    def window(self) -> int:
        """The X server's number of the window; 0 without a window."""
        return int(self._canvas.winId()) if self._canvas else 0

    def ensure_covered(self) -> bool:
        """Return whether the window still covers the SLM; otherwise cover it, neutral.

        DeviceError if the screen is missing or another monitor is connected.
        """
        try:
            there = choose_screen(self._wanted, list_outputs(self.x))
            if there.monitor != self.output.monitor:
                reply = f"another monitor is plugged in at {there}"
                raise DeviceError(
                    self._model, "find the screen", reply, f"Plug in {self.output} again"
                )
        except DeviceError:
            self.uncover()
            raise
        self._read_changes()
        lost, self._lost = self._lost, False
        stayed = self._canvas is not None and there.region == self.output.region and not lost
        self.output = there
        self.signal.follow(there)
        if stayed:
            return True
        self._cover()
        return False

    def prepare_signal(self, command: str) -> None:
        """Set right what is sent, which may be dark until `dark_until` afterwards."""
        if self.signal.prepare(command):
            self.dark_until = time.monotonic() + _RESYNC

    def check_signal(self, command: str) -> None:
        """Raise DeviceError if what is sent changed since the pattern was shown."""
        self._read_changes()
        self.signal.require_unchanged(command)

    def look_at_signal(self) -> None:
        """Note a change of what is sent, which may be over before the next check."""
        self._read_changes()
        self.signal.look()

    def draw(self, image: QImage) -> None:
        if self._canvas is not None:
            self._canvas.draw(image)

    def verify(self, command: str, grey: NDArray[np.uint8]) -> None:
        """Raise DeviceError unless this pattern is shown pixel for pixel."""
        # What was set for this pattern is reported before the answer to this request.
        self.changes.atom("EDID")
        self._read_changes()
        self.signal.begin(command)
        # A compositor may take up to half a second.
        late = time.monotonic() + 0.5
        # After a mismatch, two matches are required: another window may raise itself repeatedly.
        right, enough = 0, 1
        while right < enough:
            seen = self._read_pixels()
            wrong = readback_error(seen, grey)
            if wrong and time.monotonic() > late:
                raise self._display_error(command, wrong)
            if wrong:
                right, enough = 0, 2
                self._raise_window()
            else:
                right += 1
                if right < enough:
                    time.sleep(0.05)
        self._verified = grey, seen.view(np.uint32).copy()

    def check(self, command: str, grey: NDArray[np.uint8]) -> None:
        """Raise DeviceError if another pattern is shown, and put the window on top."""
        seen, (verified, right) = self._read_pixels(), self._verified
        # The comparison with what was read before takes a tenth of the time.
        if grey is verified and np.array_equal(seen.view(np.uint32), right):
            return
        if wrong := readback_error(seen, grey):
            self._raise_window()
            raise self._display_error(command, wrong)

    def check_band(self, command: str, grey: NDArray[np.uint8]) -> None:
        """Check only one band of a video frame, to save time.

        Each call checks the next band.
        """
        rows = -(-grey.shape[0] // _CHECKED_BANDS)
        top = self._band * rows
        self._band = (self._band + 1) % _CHECKED_BANDS
        part = grey[top : top + rows]
        if not readback_error(self._read_pixels(top, len(part)), part):
            return
        self._raise_window()
        if wrong := readback_error(self._read_pixels(), grey):
            raise self._display_error(command, wrong)

    def uncover(self) -> None:
        """Remove the window, because its place may now belong to another screen."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        if self._canvas is not None:
            self._canvas.destroy()
            self._canvas = None

    def close(self) -> None:
        self.uncover()
        with contextlib.suppress(XError):
            self.signal.restore()
        self.changes.close()
        self.x.close()

    def _cover(self) -> None:
        from drivers.screen.canvas import Canvas

        self.uncover()
        self._canvas = Canvas(self.output.region)
        self._canvas.appear(self.neutral)
        self._reader = ScreenReader(self.x.display, self.output.region)
        self.prepare_signal("show neutral")
        self.verify("show neutral", self.neutral)

    def _raise_window(self) -> None:
        from PySide6.QtGui import QGuiApplication

        if self._canvas is not None:
            self._canvas.raise_()
        QGuiApplication.processEvents()
        time.sleep(0.02)
        QGuiApplication.processEvents()

    def _read_pixels(self, top: int = 0, rows: int | None = None) -> NDArray[np.uint8]:
        if self._reader is None:
            raise DeviceError(self._model, "read the screen", "it is gone", "Plug it in again")
        return self._reader.pixels(top, rows)

    def _read_changes(self) -> None:
        """Note what the X server reported of this output since the last call."""
        seen = read_changes(self.changes, self.output)
        self._lost |= seen.lost
        self.signal.note_changes(seen.properties)

    def _display_error(self, command: str, wrong: str) -> DeviceError:
        remedy = "Take away what lies on that screen, and switch scaling and night light off"
        return DeviceError(self._model, command, wrong, remedy)


def panel_name(output: Output) -> str:
    """Return the name of an SLM: its monitor's model, or its connector."""
    return output.monitor.model or f"screen {output.name}"
