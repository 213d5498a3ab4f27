"""The SLM that a bench opens: one that is connected as a second display, as HOLOEYE's PLUTO is."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.hosted import HostedDevice
from drivers.interfaces import Identity, Setting, Surroundings
from drivers.screen.player import Presentations
from drivers.screen.screen_choice import ScreenRequest
from drivers.screen.screen_options import check_options
from drivers.screen.screen_watcher import ScreenWatcher
from drivers.screen.session import ServerGone

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class WindowTimeouts:
    """Limit how long the window is waited for, in seconds.

    open: within which the window must be open. Chosen.
    reopen: within which the window's process must be replaced after it has died. It is shorter,
    because the files are in the disk cache by then. Chosen.
    call: within which the window must answer; a call may hand over a long video. Chosen.
    """

    open: float = 30.0
    reopen: float = 4.0
    call: float = 4.0


_TIMEOUTS = WindowTimeouts()

_MAX_VIDEO_BYTES = 1 << 30
"""Largest size of a video in bytes: 517 frames of 1920x1080."""


class ScreenSLM:
    """Show patterns on an SLM that is driven as a display: 8-bit grey levels on one X screen.

    The window belongs to a child process, which shows the neutral pattern when this process
    ends. Every still is read back from the screen and compared pixel by pixel; videos are checked
    at intervals. What comes after the graphics card's memory can't be read back, but the card's
    gamma ramp, scaling, rotation and the connector's properties (such as "Broadcast RGB" and
    "max bpc") are checked: set right and logged at a new pattern where that is possible, and else
    refused. `displayed_pattern` raises DeviceError if they changed since the pattern was shown. The
    properties get their old values back at the end. A video shows one frame per refresh and skips
    none; `presentations()` returns when each was shown. While the screen is unplugged, calls
    raise DeviceError; when it returns, it shows the neutral pattern. When the window is closed,
    the desktop is visible, so give that screen a black background.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock.
    screen : str
        The output's name ("HDMI-1"), or its monitor's model or serial number ("HE PLUTO-2.1"). If
        empty, the only screen of `width` x `height` pixels that isn't the primary one.
    width, height : int
        Size of the panel in pixels, 1 to 32767.
    refresh_hz : float
        Refresh rate of the screen in hertz, 1 to 1000.
    display : str, optional
        The X server, as in DISPLAY; this session's if left out.
    settling_ms : float
        Milliseconds until the panel's liquid crystal has settled.
    allow_primary : bool
        Whether the screen may be the operator's own (primary) screen, or the only one.
    allow_ramp : bool
        Whether the graphics card's gamma ramp may change grey levels, the same ones all the time.
    allow_properties : sequence of str
        Names of the connector's properties that are left as they are, such as "max bpc". With
        "native size", the monitor may tell another size than the panel's.

    Raises
    ------
    ValueError
        If an option is invalid.
    """

    reply_time = _TIMEOUTS.reopen + _TIMEOUTS.call
    is_left_safe_when_killed = True

    def __init__(
        self,
        surroundings: Surroundings,
        screen: str = "",
        width: int = 1920,
        height: int = 1080,
        refresh_hz: float = 60.0,
        display: str | None = None,
        settling_ms: float = 100.0,
        allow_primary: bool = False,
        allow_ramp: bool = False,
        allow_properties: Sequence[str] = (),
    ) -> None:
        wanted = check_options(
            ScreenRequest(screen, width, height, refresh_hz, allow_primary, allow_properties),
            display=display,
            settling_ms=settling_ms,
            allow_ramp=allow_ramp,
        )
        self._clock = surroundings.clock
        self._model = screen or "SLM on a screen"
        self._options = {
            "model": self._model,
            "request": wanted,
            "display": display,
            "allow_ramp": allow_ramp,
        }
        self.shape = (height, width)
        self.settling = settling_ms * 1e-3
        self._window: HostedDevice | None = None
        self._notices: tuple[str, ...] = ()
        self._lookout = ScreenWatcher(wanted, display)
        self._identity = Identity(self._model, "", simulated=False)
        self.frame_time = 1 / refresh_hz
        self._entered = self._killed = False

    def __enter__(self) -> Self:
        self._open(_TIMEOUTS.open)
        self._entered = True
        return self

    def __exit__(self, *error: object) -> None:
        """Show the neutral pattern and close the window; raise nothing even if it was killed."""
        self._entered = False
        self._lookout.close()
        self._drop()

    @property
    def identity(self) -> Identity:
        return self._identity

    @property
    def displayed_pattern(self) -> str:
        """Identifier of the pattern that is shown now.

        The result is "neutral" if the screen was unplugged after the last pattern was shown. A
        still is read back again; DeviceError if something covers it.
        """
        return self._ask("shown", lambda window: window.displayed_pattern())

    def show(self, identifier: str, grey: NDArray[np.uint8]) -> Setting[str]:
        """Show grey levels, uint8 (rows, columns), and read them back."""
        command = f"show {identifier}"
        picture = self._require_grey_levels(command, np.asarray(grey), 2)
        seen = self._ask(command, lambda window: window.show(identifier, picture))
        return Setting(identifier, identifier, self._bench_time(seen) + self.settling)

    def play(self, identifier: str, video: NDArray[np.uint8]) -> Setting[str]:
        """Loop a video, uint8 (n, rows, columns), one frame per refresh."""
        command = f"play {identifier}"
        frames = self._require_grey_levels(command, np.asarray(video), 3)
        # Report a missing screen before the whole video is handed over.
        self._ask(command, lambda window: window.prepare_to_show(command))
        seen = self._ask(command, lambda window: window.play(identifier, frames))
        return Setting(identifier, identifier, self._bench_time(seen) + self.settling)

    def presentations(self) -> Presentations:
        """Return which video frames were shown, and when; DeviceError without a video."""
        told = self._ask("presentations", lambda window: window.presentations())
        if told is None:
            raise DeviceError(self._model, "presentations", "no video plays", "Play one first")
        return replace(told, times=told.times + self._bench_time(0.0))

    def health(self) -> dict[str, str]:
        return self._ask("health", lambda window: window.health())

    @property
    def notices(self) -> tuple[str, ...]:
        """What was set at the connector since it was opened; see Device."""
        return self._notices

    def make_safe(self) -> None:
        """Show grey level 0 everywhere, by another window if this one is killed."""
        try:
            self._ask("make safe", lambda window: window.make_safe())
        except DeviceError:
            if self._window is None or not self._window.is_dead:
                raise
            self._ask("make safe", lambda window: window.make_safe())

    def unplugged_reason(self) -> str | None:
        """Return why the SLM counts as unplugged, empty while it is lit; see Device.

        A separate connection to the X server is used, so that a video isn't disturbed.
        """
        return self._lookout.unplugged_reason() if self._entered and not self._killed else None

    def kill(self) -> None:
        """Kill the window's process at once, from any thread."""
        self._killed = True
        if self._window is not None:
            self._window.kill()

    def _open(self, within: float) -> HostedDevice:
        # The window's process reports times of time.monotonic(), whatever clock the bench has.
        told = Surroundings(RealClock(0.0))
        place, half = "drivers.screen.panel_device:PanelDevice", within / 2
        window = HostedDevice(
            told,
            self._model,
            place,
            self._options,
            open_timeout=half,
            reply_timeout=_TIMEOUTS.call,
        ).__enter__()
        self._window = window
        found: Identity = window.identity
        if self._entered and found != self._identity:
            self._drop()
            reply = f"this is {found.model} {found.serial}, and it was {self._identity.serial}"
            raise DeviceError(self._model, "open again", reply, "Plug in the one that was there")
        self._identity, self.frame_time = found, window.frame_time
        self._model = found.model
        self._log_notes(window)
        return window

    def _ask(self, command: str, call: Callable[[Any], T]) -> T:
        """Send a call to the window's process; replace the process if it has died."""
        if not self._entered or self._killed:
            raise DeviceError(self._model, command, "it is closed", "Open it again")
        window = self._window
        if window is None or window.is_dead:
            self._drop()
            window = self._open(_TIMEOUTS.reopen)
        try:
            answer = call(window)
            self._log_notes(window)
            return answer
        except ServerGone:
            # The window ended with the X server, so nothing is left to be made safe.
            window.kill()
            self._drop()
            raise

    def _log_notes(self, window: Any) -> None:
        """Log what was set, or happened to the signal, since the last call."""
        if notes := window.notes():
            self._notices = window.settings()
        for note in notes:
            log.warning("%s: %s", self._model, note)

    def _drop(self) -> None:
        window, self._window = self._window, None
        if window is not None:
            try:
                window.__exit__(None, None, None)
            except DeviceError:
                window.kill()

    def _bench_time(self, monotonic: float) -> float:
        return self._clock.now() + monotonic - time.monotonic()

    def _require_grey_levels(
        self, command: str, grey: NDArray[Any], axes: int
    ) -> NDArray[np.uint8]:
        right = grey.ndim == axes and grey.shape[-2:] == self.shape and grey.size
        if grey.dtype != np.uint8 or not right:
            wanted = "x".join(("frames", *map(str, self.shape))[-axes:])
            reply = f"{grey.dtype} of shape {grey.shape} isn't uint8 of {wanted}"
            raise DeviceError(self._model, command, reply, "Compute it again")
        if grey.nbytes > _MAX_VIDEO_BYTES:
            reply = f"{grey.nbytes >> 20} MiB are more than {_MAX_VIDEO_BYTES >> 20}"
            raise DeviceError(self._model, command, reply, "Show fewer frames")
        return np.ascontiguousarray(grey)
