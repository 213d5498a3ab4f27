"""The panel's place on the X screen: found, covered, watched, and left when it is gone."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.screen.checking import what_differs, what_ramp_does
from drivers.screen.choosing import Wanted, choose
from drivers.screen.session import connect
from drivers.x11 import ScreenReader, XConnection
from drivers.x11.outputs import Output, outputs, ramp, was_lost, watch_changes

if TYPE_CHECKING:
    from PySide6.QtGui import QImage

    from drivers.screen.canvas import Canvas

_APPEARING = 0.5
"""Seconds in which a picture must be on the screen: compositors take their time."""

_AGAIN = 0.05
"""Seconds until a picture that came late is looked at once more."""

_BANDS = 4
"""Parts of a video's frame that are looked at one after the other."""


class Stage:
    """Where pictures are shown, and read back.

    model: in errors. display: as in DISPLAY, that of the environment if None.
    """

    def __init__(self, model: str, wanted: Wanted, display: str | None, allow_ramp: bool) -> None:
        self._model, self._wanted, self._allow_ramp = model, wanted, allow_ramp
        self._canvas: Canvas | None = None
        self._reader: ScreenReader | None = None
        self._band = 0
        self.x = connect(model, display)
        self.output = choose(wanted, outputs(self.x))
        self.plain_ramp = self._check_ramp()
        self.changes = XConnection(self.x.display)
        watch_changes(self.changes)
        # No screen saver while we are connected; without the extension nobody blanks either.
        if self.x.has("MIT-SCREEN-SAVER"):
            self.x.order("MIT-SCREEN-SAVER", 5, "I", 1)
        from drivers.screen.canvas import application

        application(self.x.display)
        self.neutral = np.zeros((wanted.height, wanted.width), np.uint8)
        self._cover()

    @property
    def window(self) -> int:
        """The X server's number of the window."""
        return int(self._canvas.winId()) if self._canvas else 0

    def require(self) -> bool:
        """Be on the screen; false if it had to be covered anew, and is neutral now.

        DeviceError if the screen isn't there, or isn't the same.
        """
        try:
            there = choose(self._wanted, outputs(self.x))
            if there.monitor != self.output.monitor:
                reply = f"another monitor is plugged in at {there}"
                raise DeviceError(
                    self._model, "find the screen", reply, f"Plug in {self.output} again"
                )
        except DeviceError:
            self.uncover()
            raise
        lost = was_lost(self.changes, self.output)
        if self._canvas is not None and there.region == self.output.region and not lost:
            self.output = there
            return True
        self.output = there
        self._cover()
        return False

    def draw(self, image: QImage) -> None:
        if self._canvas is not None:
            self._canvas.draw(image)

    def verify(self, command: str, grey: NDArray[np.uint8]) -> None:
        """DeviceError if the screen doesn't show this, pixel for pixel, or changes its levels."""
        self.plain_ramp = self._check_ramp()
        late = time.monotonic() + _APPEARING
        # Once it was wrong, right twice: another window may fight for its place.
        right, enough = 0, 1
        while right < enough:
            wrong = what_differs(self._seen(), grey)
            if wrong and time.monotonic() > late:
                raise self._wrong(command, wrong)
            if wrong:
                right, enough = 0, 2
                self._come_to_top()
            else:
                right += 1
                if right < enough:
                    time.sleep(_AGAIN)

    def look(self, command: str, grey: NDArray[np.uint8]) -> None:
        """DeviceError if something else stands there now, which then is covered again."""
        if wrong := what_differs(self._seen(), grey):
            self._come_to_top()
            raise self._wrong(command, wrong)

    def glance(self, command: str, grey: NDArray[np.uint8]) -> None:
        """The same for a part of a picture that is shown now, in little time."""
        rows = -(-grey.shape[0] // _BANDS)
        top = self._band * rows
        self._band = (self._band + 1) % _BANDS
        part = grey[top : top + rows]
        if not what_differs(self._seen(top, len(part)), part):
            return
        self._come_to_top()
        if wrong := what_differs(self._seen(), grey):
            raise self._wrong(command, wrong)

    def uncover(self) -> None:
        """Take the window away: what was its place may now be another screen's."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        if self._canvas is not None:
            self._canvas.destroy()
            self._canvas = None

    def close(self) -> None:
        self.uncover()
        self.changes.close()
        self.x.close()

    def _cover(self) -> None:
        from drivers.screen.canvas import Canvas

        self.uncover()
        self._canvas = Canvas(self.output.region)
        self._canvas.appear(self.neutral)
        self._reader = ScreenReader(self.x.display, self.output.region)
        self.verify("show neutral", self.neutral)

    def _come_to_top(self) -> None:
        from PySide6.QtGui import QGuiApplication

        if self._canvas is not None:
            self._canvas.raise_()
        QGuiApplication.processEvents()
        time.sleep(0.02)
        QGuiApplication.processEvents()

    def _seen(self, top: int = 0, rows: int | None = None) -> NDArray[np.uint8]:
        if self._reader is None:
            raise DeviceError(self._model, "read the screen", "it is gone", "Plug it in again")
        return self._reader.pixels(top, rows)

    def _check_ramp(self) -> bool:
        found = ramp(self.x, self.output.crtc)
        if not self.output.refresh and not found.any():
            return True  # nothing is scanned out of a virtual screen, which leaves its ramp empty
        changed = what_ramp_does(found)
        if changed and not self._allow_ramp:
            remedy = (
                f"Switch night light and colour profiles off, then xrandr --output "
                f"{self.output.name} --gamma 1 --brightness 1; or write allow_ramp = true"
            )
            raise DeviceError(self._model, "read the gamma ramp", changed, remedy)
        return not changed

    def _wrong(self, command: str, wrong: str) -> DeviceError:
        remedy = "Take away what lies on that screen, and switch scaling and night light off"
        return DeviceError(self._model, command, wrong, remedy)


def describe(output: Output) -> str:
    """The panel's name: its monitor's, or its connector's."""
    return output.monitor.model or f"screen {output.name}"
