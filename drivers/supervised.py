"""A device under watch: owned by one thread, every call in time, whatever the device does."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from dataclasses import replace
from typing import Any, Self

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting
from drivers.worker import Worker

log = logging.getLogger(__name__)

OPEN_TIMEOUT = 60.0
"""Seconds in which a device must be open: some initialise for half a minute."""

_TIMEOUT_MARGIN = 1.0
"""Seconds beyond a device's documented time, after which nobody waits for it any more."""

_CANCEL_GRACE = 1.0
"""Seconds in which a call may end, by itself or because it is due, once it is cancelled."""

_KILL_TIMEOUT = 0.5
"""Seconds in which a killed device's call must end."""

_POLL_INTERVAL = 0.01
"""Seconds between looks at whether a wait was cancelled."""


def _never() -> bool:
    return False


class SupervisedDevice:
    """Stands for a device, in the words of the device's own interface.

    role: what the bench calls it. make: makes the device, which is entered at once.
    simulated: whether what its driver talks to is known to be. Every
    call runs in the device's own thread, one after the other whoever asks. A call that
    doesn't end within the device's documented time and a second makes the device a dead one:
    it is killed where it can be and given up where it can't, and this and every later call
    is a DeviceError that names it, until `revive()` has opened a new one. So does a call that
    goes on for a second after `cancelled` has turned true.
    """

    def __init__(self, role: str, make: Callable[[], Any], *, simulated: bool = False) -> None:
        self.role = role
        self.cancelled: Callable[[], bool] = _never
        """Asked while calls last; who has begun something that can be cancelled sets it."""
        self._make = make
        self._simulated = simulated
        self._devices: list[Any] = []
        self._device: Any = None
        self._model = role
        self._reply_time = OPEN_TIMEOUT
        self._entered = False
        self._failure_reason = "is not open"
        self._turn = threading.RLock()

    def __enter__(self) -> Self:
        self._open()
        self._entered = True
        return self

    def __exit__(self, *error: object) -> None:
        self._entered = False
        self._close_if_alive()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(f"{self.__dict__.get('role', 'device')} has no {name}")
        # Looked up in its thread, too: what looks like a value may be a question on the wire.
        found = self._call(name, lambda device: getattr(device, name))
        if not callable(found):
            return found

        def forward_call(*given: Any, **named: Any) -> Any:
            # Of the device that is there then: this one may have been replaced.
            return self._call(name, lambda device: getattr(device, name)(*given, **named))

        return forward_call

    @property
    def identity(self) -> Identity:
        told: Identity = self._call("identity", lambda device: device.identity)
        return replace(told, simulated=True) if self._simulated else told

    @property
    def failure_reason(self) -> str:
        """Why the device is given up; empty while it isn't."""
        return self._failure_reason

    @property
    def can_report_unplugging(self) -> bool:
        """Whether it is a device that can say that it was unplugged without being disturbed."""
        return callable(getattr(type(self._device), "unplugged_reason", None))

    def unplugged_reason(self) -> str | None:
        """Why the device counts as unplugged, and which it is; empty while it is there.

        From any thread, at once, whatever call goes on. None where that can't be told now.
        """
        if self._failure_reason or not self.can_report_unplugging:
            return None
        try:
            why: str | None = self._device.unplugged_reason()
        except Exception:
            # What is wrong with it, the next call tells.
            return None
        return f"{self._model}: {why}" if why else why

    def begin_make_safe(self) -> Callable[[], None]:
        """Begin to make the device safe; the result waits for it, or raises DeviceError.

        A dead device is opened again first, for it may have been left in any state.
        """
        if self._failure_reason and self._entered:
            helper = Worker(f"{self.role} again")
            again = helper.submit(self._revive_safely)
            helper.end()
            return again.result
        if self._failure_reason:
            return lambda: self._require_alive("make safe")
        device = self._device
        done = self._worker.submit(lambda: device.make_safe())

        def finish() -> None:
            with self._only_device_errors("make safe"):
                self._wait("make safe", done, self._reply_time + _TIMEOUT_MARGIN)

        return finish

    def make_safe(self) -> None:
        self.begin_make_safe()()

    def revive(self) -> None:
        """Open a new device in place of this one. DeviceError if that fails, too."""
        with self._turn, self._only_device_errors("open"):
            self._close_if_alive()
            self._open()
        log.info("%s: opened again", self.role)

    def _revive_safely(self) -> None:
        self.revive()
        self.make_safe()

    def _open(self) -> None:
        with self._turn:
            self._worker = worker = Worker(self.role)
            self._devices, self._device = [], None
            made = self._devices
            try:
                self._device = device = self._ask(
                    "open", lambda: self._make_and_enter(worker, made), OPEN_TIMEOUT
                )
                self._model = self._ask("identity", lambda: device.identity.model, OPEN_TIMEOUT)
                self._reply_time = self._ask("reply_time", lambda: device.reply_time, OPEN_TIMEOUT)
                self._failure_reason = ""
            except BaseException as error:
                if not worker.has_ended:
                    self._failure_reason = f"could not be opened: {error}"
                    if self._device is not None:
                        self._close()
                worker.give_up()
                raise

    def _make_and_enter(self, worker: Worker, made: list[Any]) -> Any:
        """Open a device. made: is told of it meanwhile, so that it can be killed."""
        device = self._make()
        made.append(device)
        if worker.has_ended:
            return None
        with self._only_device_errors("open"):
            entered = device.__enter__()
        made.append(entered)
        if worker.has_ended:
            # Nobody waits for it any more, and who tries again shall not find it in use.
            entered.__exit__(None, None, None)
        return entered

    def _close_if_alive(self) -> None:
        """Close the device, if it isn't dead."""
        with self._turn:
            if self._failure_reason:
                return
            try:
                self._close()
            finally:
                self._failure_reason = self._failure_reason or "is closed"
                self._worker.end()

    def _close(self) -> None:
        """What the device says to that is only logged."""
        device = self._device
        try:
            self._ask("close", lambda: device.__exit__(None, None, None), OPEN_TIMEOUT)
        except Exception as error:
            log.warning("%s: closing: %s", self.role, error)

    def _require_alive(self, command: str) -> None:
        if self._failure_reason:
            raise self._error(command, f"the device {self._failure_reason}", "Open the bench again")

    def _call(
        self,
        command: str,
        work: Callable[[Any], Any],
        exposure_time: float = 0.0,
        cancelled: Callable[[], bool] = _never,
    ) -> Any:
        """Have the device do something, which may take as long as it documents."""
        with self._turn:
            self._require_alive(command)
            device, seconds = self._device, exposure_time + self._reply_time + _TIMEOUT_MARGIN
            return self._ask(
                command, lambda: work(device), seconds, lambda: cancelled() or self.cancelled()
            )

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
        while not wait([done], timeout=_POLL_INTERVAL).done:
            now = time.monotonic()
            if not heard and cancelled():
                heard, late, seconds = True, min(late, now + _CANCEL_GRACE), _CANCEL_GRACE
            if now > late and (heard or now > self._progress_deadline):
                after = " after it was cancelled" if heard else ""
                self._give_up(command, done, f"hangs: no answer within {seconds:.1f} s{after}")
        if done.cancelled():
            # Given up because of another call, before this one's turn.
            self._require_alive(command)
        try:
            return done.result()
        except DeviceError as error:
            error.role = self.role
            raise

    @property
    def _progress_deadline(self) -> float:
        """How long a device that gets on is waited for.

        Only what lies at hand is looked at: its thread is busy, and may hang.
        """
        told: float = getattr(self._device, "__dict__", {}).get("alive_at", 0.0)
        return told + self._reply_time + _TIMEOUT_MARGIN

    def _give_up(self, command: str, done: Future[Any], why: str) -> None:
        """Kill the device if it can be killed, give its thread up if not, and say so."""
        end = "it was killed" if self._kill(done) else "it was given up"
        self._failure_reason = f"hung at {command}, and {end}"
        self._worker.give_up()
        raise self._error(command, f"{why}; {end}", "Look at the device and its cable")

    def _kill(self, done: Future[Any]) -> bool:
        """Whether the call has ended because the device could be killed."""
        device: Any = self._devices[-1] if self._devices else None
        if not callable(getattr(type(device), "kill", None)):
            return False
        # Who knows whether that hangs, too?
        killer = Worker(f"{self.role} killed")
        killer.submit(lambda: device.kill())
        killer.end()
        if not wait([done], timeout=_KILL_TIMEOUT).done:
            return False
        # It frees what it holds here.
        wait(
            [self._worker.submit(lambda: device.__exit__(None, None, None))], timeout=_KILL_TIMEOUT
        )
        return True

    @contextlib.contextmanager
    def _only_device_errors(self, command: str) -> Iterator[None]:
        """Whatever a driver raises where nobody expects but a DeviceError."""
        try:
            yield
        except DeviceError:
            raise
        except Exception as error:
            reply = f"{type(error).__name__}: {error}"
            raise self._error(command, reply, "Look at the device and its cable") from error

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        error = DeviceError(self._model, command, reply, remedy)
        error.role = self.role
        return error


class SupervisedCamera(SupervisedDevice):
    """A camera under watch: an exposure may take as long as it was set to.

    pace: seconds of the wall in one of the bench's, where those are longer.
    """

    def __init__(
        self,
        role: str,
        make: Callable[[], Any],
        pace: float = 1.0,
        *,
        simulated: bool = False,
    ) -> None:
        super().__init__(role, make, simulated=simulated)
        self._pace = max(1.0, pace)
        self._frame_time = 0.0

    def set_exposure(self, exposure: float) -> Setting[float]:
        def work(device: Any) -> tuple[Setting[float], float]:
            setting = device.set_exposure(exposure)
            return setting, setting.actual + device.frame_time

        setting, self._frame_time = self._call("set exposure", work)
        return setting

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        """DeviceError if the frame isn't there in time; see Camera.capture()."""
        unwanted = threading.Event()

        def stop() -> bool:
            return unwanted.is_set() or cancelled()

        try:
            return self._call(
                "capture",
                lambda device: device.capture(stop),
                self._frame_time * self._pace,
                cancelled,
            )
        except BaseException:
            # Broken off, by Ctrl-C for example: the camera, too, needs to wait no longer.
            unwanted.set()
            raise
