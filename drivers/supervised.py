"""A device under watch: owned by one thread, every call in time, whatever the device does."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, Self

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Setting
from drivers.worker import Worker

log = logging.getLogger(__name__)

OPENING = 60.0
"""Seconds in which a device must be open: some initialise for half a minute."""

_MARGIN = 1.0
"""Seconds beyond a device's documented time, after which nobody waits for it any more."""

_GRACE = 0.5
"""Seconds in which a camera may end an exposure by itself once it is cancelled."""

_KILLING = 0.5
"""Seconds in which a killed device's call must end."""

_LOOK = 0.01
"""Seconds between looks at whether a wait was cancelled."""


def _never() -> bool:
    return False


class Supervised:
    """Stands for a device, in the words of the device's own interface.

    role: what the bench calls it. make: makes the device, which is entered at once. Every
    call runs in the device's own thread. A call that doesn't end within the device's
    documented time and a second makes the device a dead one: it is killed where it can be
    and given up where it can't, and this and every later call is a DeviceError that names
    it, until `revive()` has opened a new one.
    """

    def __init__(self, role: str, make: Callable[[], Any]) -> None:
        self.role = role
        self._make = make
        self._device: Any = None
        self._model = role
        self._reply_time = OPENING
        self._death = ""

    def __enter__(self) -> Self:
        self._open()
        return self

    def __exit__(self, *error: object) -> None:
        self._leave()

    def __getattr__(self, name: str) -> Any:
        device = self.__dict__.get("_device")
        if name.startswith("_") or device is None:
            raise AttributeError(f"{self.__dict__.get('role', 'device')} has no {name}")
        # Looked up in its thread, too: what looks like a value may be a question on the wire.
        found = self._call(name, lambda: getattr(device, name))
        if not callable(found):
            return found
        return lambda *given: self._call(name, lambda: found(*given))

    @property
    def dead(self) -> str:
        """Why the device is given up; empty while it isn't."""
        return self._death

    def begin_make_safe(self) -> Callable[[], None]:
        """Begin to make the device safe; the result waits for it, or raises DeviceError.

        A dead device is opened again first, for it may have been left in any state.
        """
        if self._death:
            return self._revive_safely
        done = self._worker.submit(self._device.make_safe)
        return lambda: self._wait("make safe", done, self._reply_time + _MARGIN)

    def make_safe(self) -> None:
        self.begin_make_safe()()

    def revive(self) -> None:
        """Open a new device in place of this one. DeviceError if that fails, too."""
        self._leave()
        self._open()
        log.info("%s: opened again", self.role)

    def _revive_safely(self) -> None:
        self.revive()
        self.make_safe()

    def _open(self) -> None:
        self._worker = Worker(self.role)
        self._reply_time, self._death = OPENING, ""
        self._device = None
        try:
            self._device = self._ask("open", self._make_and_enter, OPENING)
            self._model = self._call("identity", lambda: self._device.identity.model)
            self._reply_time = self._call("reply_time", lambda: self._device.reply_time)
        except BaseException as error:
            self._death = self._death or f"could not be opened: {error}"
            self._worker.end()
            raise

    def _make_and_enter(self) -> Any:
        device = self._make()
        return device.__enter__()

    def _leave(self) -> None:
        """Close the device, however it stands; what it says to that is only logged."""
        if self._device is not None and not self._death:
            try:
                self._ask("close", lambda: self._device.__exit__(None, None, None), OPENING)
            except Exception as error:
                log.warning("%s: closing: %s", self.role, error)
        if not self._death:
            self._death = "is closed"
        self._worker.end()

    def _require_alive(self, command: str) -> None:
        if self._death:
            raise self._error(command, f"the device {self._death}", "Open the bench again")

    def _call(self, command: str, work: Callable[[], Any]) -> Any:
        self._require_alive(command)
        return self._ask(command, work, self._reply_time + _MARGIN)

    def _ask(
        self,
        command: str,
        work: Callable[[], Any],
        seconds: float,
        cancelled: Callable[[], bool] = _never,
    ) -> Any:
        return self._wait(command, self._worker.submit(work), seconds, cancelled)

    def _wait(
        self,
        command: str,
        done: Future[Any],
        seconds: float,
        cancelled: Callable[[], bool] = _never,
    ) -> Any:
        """The result of a call; DeviceError and death if it doesn't come in time."""
        late = time.monotonic() + seconds
        heard = False
        while not wait([done], timeout=_LOOK).done:
            now = time.monotonic()
            if not heard and cancelled():
                heard, late, seconds = True, min(late, now + _GRACE), _GRACE
            if now > late:
                after = " after it was cancelled" if heard else ""
                self._give_up(command, done, f"hangs: no answer within {seconds:.1f} s{after}")
        try:
            return done.result()
        except DeviceError as error:
            error.role = self.role
            raise

    def _give_up(self, command: str, done: Future[Any], why: str) -> None:
        """Kill the device if it can be killed, give its thread up if not, and say so."""
        device = self._device
        end = "it was given up"
        if callable(getattr(type(device), "kill", None)):
            with contextlib.suppress(Exception):
                device.kill()
            wait([done], timeout=_KILLING)
            end = "it was killed"
        self._death = f"hung at {command}, and {end}"
        self._worker.end()
        raise self._error(command, f"{why}; {end}", "Look at the device and its cable")

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        error = DeviceError(self._model, command, reply, remedy)
        error.role = self.role
        return error


class SupervisedCamera(Supervised):
    """A camera under watch: an exposure may take as long as it was set to."""

    def __init__(self, role: str, make: Callable[[], Any]) -> None:
        super().__init__(role, make)
        self._frame_time = 0.0

    def set_exposure(self, exposure: float) -> Setting[float]:
        def work() -> tuple[Setting[float], float]:
            setting = self._device.set_exposure(exposure)
            return setting, setting.actual + self._device.frame_time

        setting, self._frame_time = self._call("set exposure", work)
        return setting

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        """DeviceError if the frame isn't there in time; see Camera.capture()."""
        device, seconds = self._device, self._frame_time + self._reply_time + _MARGIN
        self._require_alive("capture")
        return self._ask("capture", lambda: device.capture(cancelled), seconds, cancelled)
