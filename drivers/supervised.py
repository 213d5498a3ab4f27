"""Run each device in a thread of its own, so that a call that hangs ends in time."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, wait
from dataclasses import dataclass, replace
from typing import Any, Self

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting
from drivers.worker import Worker

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SupervisionTiming:
    """Tune how long a device is waited for, in seconds.

    open_timeout: until it must be open (chosen; some devices initialise for half a minute).
    timeout_margin: beyond a device's documented time until a call counts as hanging (chosen).
    cancel_grace: until a call must end after it was cancelled (chosen).
    kill_timeout: until the call of a killed device must end (chosen).
    poll_interval: between checks whether a wait was cancelled (chosen).
    """

    open_timeout: float = 60.0
    timeout_margin: float = 1.0
    cancel_grace: float = 1.0
    kill_timeout: float = 0.5
    poll_interval: float = 0.01


SETTINGS = SupervisionTiming()


def _has_ended(done: Future[Any], seconds: float) -> bool:
    """Return whether a call has ended, or ends within some seconds.

    For one call, this takes half of what concurrent.futures.wait() does.
    """
    try:
        done.exception(timeout=seconds)
    except CancelledError:
        return True
    except TimeoutError:
        return False
    return True


def _never() -> bool:
    return False


class SupervisedDevice:
    """Stand in for a device, with its interface, and end every call in time.

    role: the device's role on the bench. make: function that makes the device, which is entered at
    once. simulated: whether the driver is known to talk to a simulated device.

    All calls run one after the other in the device's own thread. A call counts as hanging if it
    takes a second longer than the device documents, or goes on for a second after `cancelled` has
    become true. The device is then killed if possible and given up otherwise. This call and every
    later one raise a DeviceError that names the hanging call, until `revive()` has opened a new
    device.
    """

    def __init__(self, role: str, make: Callable[[], Any], *, simulated: bool = False) -> None:
        self.role = role
        self.cancelled: Callable[[], bool] = _never
        """Function that is polled during calls; a caller that can be cancelled sets it."""
        self._make = make
        self._simulated = simulated
        self._devices: list[Any] = []
        self._device: Any = None
        self._model = role
        self._reply_time = SETTINGS.open_timeout
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
        self._require_alive(name)
        is_method = callable(getattr(type(self._device), name, None))
        # Looking up anything else runs in the device's thread, because it may query the device.
        found = None if is_method else self._read(name)
        if not (is_method or callable(found)):
            return found

        def forward_call(*given: Any, **named: Any) -> Any:
            # The attribute is looked up again, because the device may have been replaced since.
            return self._call(name, lambda device: getattr(device, name)(*given, **named))

        return forward_call

    def _read(self, name: str) -> Any:
        """Read an attribute; what the device object itself holds needs no thread."""
        with self._turn:
            held = getattr(self._device, "__dict__", {})
            if name in held and not hasattr(type(self._device), name):
                self._require_alive(name)
                return held[name]
        return self._call(name, lambda device: getattr(device, name))

    @property
    def identity(self) -> Identity:
        told: Identity = self._call("identity", lambda device: device.identity)
        return replace(told, simulated=True) if self._simulated else told

    @property
    def failure_reason(self) -> str:
        """Why the device can't be used; empty while it can."""
        return self._failure_reason

    @property
    def can_report_unplugging(self) -> bool:
        """Whether the device has a method unplugged_reason()."""
        return callable(getattr(type(self._device), "unplugged_reason", None))

    def unplugged_reason(self) -> str | None:
        """Return why the device counts as unplugged, with its model; empty while it is there.

        Any thread may call it, and it returns at once, even during another call. The result is
        None if it is unknown whether the device is there.
        """
        if self._failure_reason or not self.can_report_unplugging:
            return None
        try:
            why: str | None = self._device.unplugged_reason()
        except Exception:
            # The next call of the device reports its failure.
            return None
        return f"{self._model}: {why}" if why else why

    @property
    def notices(self) -> tuple[str, ...]:
        """What the driver changed for all frames; empty if it can't tell."""
        has_notices = hasattr(type(self._device), "notices")
        return tuple(self._device.notices) if has_notices else ()

    def begin_make_safe(self) -> Callable[[], None]:
        """Begin to make the device safe; the returned function waits for the end.

        That function raises DeviceError if the device can't be made safe. A device that was given
        up, or whose process was killed, is opened again first, because it may be in any state.
        """
        if self._entered and (self._failure_reason or self._is_dead):
            helper = Worker(f"{self.role} again")
            again = helper.submit(self._revive_safely)
            helper.end()
            return again.result
        if self._failure_reason:
            return lambda: self._require_alive("make safe")
        device = self._device
        done = self._worker.submit(lambda: device.make_safe())

        def finish() -> None:
            try:
                with self._only_device_errors("make safe"):
                    self._wait("make safe", done, self._reply_time + SETTINGS.timeout_margin)
            except DeviceError:
                if not (self._entered and self._is_dead):
                    raise
                self._revive_safely()

        return finish

    @property
    def _is_dead(self) -> bool:
        """Whether the device runs in a process that has ended."""
        device = self._device
        return hasattr(type(device), "is_dead") and bool(device.is_dead)

    def make_safe(self) -> None:
        self.begin_make_safe()()

    def revive(self) -> None:
        """Open a new device in place of this one; DeviceError if that fails."""
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
            made, timeout = self._devices, SETTINGS.open_timeout
            try:
                self._device = device = self._ask(
                    "open", lambda: self._make_and_enter(worker, made), timeout
                )
                self._model = self._ask("identity", lambda: device.identity.model, timeout)
                self._reply_time = self._ask("reply_time", lambda: device.reply_time, timeout)
                self._failure_reason = ""
            except BaseException as error:
                if not worker.has_ended:
                    self._failure_reason = f"could not be opened: {error}"
                    if self._device is not None:
                        self._close()
                worker.give_up()
                raise

    def _make_and_enter(self, worker: Worker, made: list[Any]) -> Any:
        """Make and enter the device.

        made: list to which the device is added early, so that it can be killed.
        """
        device = self._make()
        made.append(device)
        if worker.has_ended:
            return None
        with self._only_device_errors("open"):
            entered = device.__enter__()
        made.append(entered)
        if worker.has_ended:
            # The caller has given up waiting. The device is closed, so that it can be opened again.
            entered.__exit__(None, None, None)
        return entered

    def _close_if_alive(self) -> None:
        """Close the device unless it was given up."""
        with self._turn:
            if self._failure_reason:
                return
            try:
                self._close()
            finally:
                self._failure_reason = self._failure_reason or "is closed"
                self._worker.end()

    def _close(self) -> None:
        """Close the device; a failure is only logged."""
        device = self._device
        try:
            self._ask("close", lambda: device.__exit__(None, None, None), SETTINGS.open_timeout)
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
        """Call the device, with a timeout based on its documented reply time."""
        with self._turn:
            self._require_alive(command)
            device = self._device
            seconds = exposure_time + self._reply_time + SETTINGS.timeout_margin
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
        """Wait for a call's result; give the device up after a timeout."""
        late = time.monotonic() + seconds
        heard = False
        interval = SETTINGS.poll_interval
        while not _has_ended(done, interval):
            now = time.monotonic()
            if not heard and cancelled():
                heard, seconds = True, SETTINGS.cancel_grace
                late = min(late, now + seconds)
            if now > late and (heard or now > self._progress_deadline):
                after = " after it was cancelled" if heard else ""
                self._give_up(command, done, f"hangs: no answer within {seconds:.1f} s{after}")
        if done.cancelled():
            # Another call has hung and the device was given up before this call began.
            self._require_alive(command)
        try:
            return done.result()
        except DeviceError as error:
            error.role = self.role
            raise

    @property
    def _progress_deadline(self) -> float:
        """Time until which to wait for a device that reports progress by `alive_at`.

        Only the instance's dictionary is read, because the device's thread is busy and may hang.
        """
        told: float = getattr(self._device, "__dict__", {}).get("alive_at", 0.0)
        return told + self._reply_time + SETTINGS.timeout_margin

    def _give_up(self, command: str, done: Future[Any], why: str) -> None:
        """Kill a hanging device or give up its thread; the DeviceError says which."""
        end = "it was killed" if self._kill(done) else "it was given up"
        self._failure_reason = f"hung at {command}, and {end}"
        self._worker.give_up()
        raise self._error(command, f"{why}; {end}", "Look at the device and its cable")

    def _kill(self, done: Future[Any]) -> bool:
        """Kill a device that has kill(); return whether the hanging call has ended."""
        device: Any = self._devices[-1] if self._devices else None
        if not callable(getattr(type(device), "kill", None)):
            return False
        # kill() runs in a thread of its own, because it may hang as well.
        killer = Worker(f"{self.role} killed")
        killer.submit(lambda: device.kill())
        killer.end()
        timeout = SETTINGS.kill_timeout
        if not wait([done], timeout=timeout).done:
            return False
        # The killed device frees its resources in this process.
        wait([self._worker.submit(lambda: device.__exit__(None, None, None))], timeout=timeout)
        return True

    @contextlib.contextmanager
    def _only_device_errors(self, command: str) -> Iterator[None]:
        """Turn any exception of a driver into a DeviceError."""
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
    """Stand in for a camera and end every call in time; a capture may take its exposure longer.

    pace: seconds of real time in a second of the bench's clock; less than 1 counts as 1.
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
        """Take a frame; DeviceError if it doesn't come in time. See Camera.capture()."""
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
            # After an exception, for example by Ctrl-C, the camera's capture is cancelled, too.
            unwanted.set()
            raise
