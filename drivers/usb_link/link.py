"""The way to one USB device."""

from __future__ import annotations

import contextlib
import errno
import threading
from collections.abc import Callable, Iterator
from typing import Any

from drivers.errors import DeviceError
from drivers.usb_link.backend import load_backend, require_backend_name
from drivers.usb_link.device_strings import (
    STRING_TIMEOUT,
    UsbIdentity,
    describe_identity,
    read_string,
)
from drivers.usb_link.error_messages import CABLE, explain_usb_error


class UsbLink:
    """The way to one USB device, by vendor and product and, if there are several, by serial.

    Every failure is a DeviceError, and comes `timeout` seconds after a transfer's beginning at
    the latest; opening the device, where that is needed, takes 3 seconds at most besides. A
    device that was unplugged is opened again by the next call; if another one answers then,
    that is a DeviceError, too. backend: see drivers.usb_link.backend.
    """

    def __init__(
        self,
        model: str,
        vendor: int,
        product: int,
        serial: str = "",
        backend: str = "",
        interface: int = 0,
        timeout: float = 1.0,
    ) -> None:
        if not isinstance(serial, str):
            raise ValueError(f"serial is {serial!r}; give it in quotes, or none")
        require_backend_name(backend)
        self.timeout = timeout
        self.may_have_late_replies = False
        """Whether a call has failed since this was last set to false: answers may be late."""
        self._model, self._vendor, self._product = model, vendor, product
        self._serial, self._backend_name = serial, backend
        self._interface = interface
        self._backend: Any = None
        self._device: Any = None
        self._kernel_driver_detached = False
        self._first_identity: UsbIdentity | None = None
        self._matching_count = 0
        self._cancelled = threading.Event()

    @property
    def identity(self) -> UsbIdentity:
        """What the device said of itself when it was opened first."""
        return self._first_identity or UsbIdentity("", "", "", "")

    @property
    def is_open(self) -> bool:
        return self._device is not None

    @property
    def is_cancelled(self) -> bool:
        """Whether somebody has given the device up."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """No transfer begins any more; from any thread. Whose turn it is lets the device go."""
        self._cancelled.set()

    def open(self, command: str = "open") -> None:
        """Find and claim the device, if that isn't done."""
        self._require_not_cancelled(command)
        if self._device is not None:
            return
        self.may_have_late_replies = True
        try:
            with self._translate_errors(command, STRING_TIMEOUT):
                if self._backend is None:
                    self._backend = load_backend(self._backend_name)
                self._device = self._find(command)
                self._claim()
                self._require_same_device(command)
                self._matching_count = self._count_matching()
        except BaseException:
            self.close()
            raise

    def unplugged_reason(self) -> str | None:
        """Why the device counts as unplugged, empty while it is there; from any thread.

        Told by the system's list of devices, and nothing is said to it; None before it was found.
        """
        if self._backend is None or not self._matching_count:
            return None
        try:
            there = self._count_matching()
        except Exception:
            return None
        return "" if there >= self._matching_count else "it was unplugged"

    def close(self) -> None:
        """Give the device back to the system; never fails."""
        device, self._device = self._device, None
        if device is None:
            return
        import usb.util

        with contextlib.suppress(Exception):
            usb.util.release_interface(device, self._interface)
        if self._kernel_driver_detached:
            with contextlib.suppress(Exception):
                device.attach_kernel_driver(self._interface)
            self._kernel_driver_detached = False
        with contextlib.suppress(Exception):
            usb.util.dispose_resources(device)

    def control_out(
        self,
        command: str,
        request_type: int,
        request: int,
        value: int,
        data: bytes,
        seconds: float | None = None,
    ) -> None:
        """A control transfer to the device; DeviceError unless it takes all of it."""
        given = (request_type, request, value, self._interface, data)
        taken = self._transfer(command, lambda one, ms: one.ctrl_transfer(*given, ms), seconds)
        self._require_all(command, int(taken), data)

    def control_in(
        self,
        command: str,
        request_type: int,
        request: int,
        value: int,
        length: int,
        seconds: float | None = None,
    ) -> bytes:
        """A control transfer from the device: up to `length` bytes."""
        given = (request_type, request, value, self._interface, length)
        return bytes(
            self._transfer(command, lambda one, ms: one.ctrl_transfer(*given, ms), seconds)
        )

    def read(self, command: str, endpoint: int, length: int, seconds: float | None = None) -> bytes:
        """Up to `length` bytes from a bulk or interrupt endpoint; a halted one is cleared."""
        return bytes(
            self._transfer(
                command, lambda one, ms: one.read(endpoint, length, ms), seconds, endpoint
            )
        )

    def write(self, command: str, endpoint: int, data: bytes, seconds: float | None = None) -> None:
        """All of the bytes to a bulk or interrupt endpoint."""
        taken = self._transfer(
            command, lambda one, ms: one.write(endpoint, data, ms), seconds, endpoint
        )
        self._require_all(command, int(taken), data)

    def _require_all(self, command: str, taken: int, data: bytes) -> None:
        if taken != len(data):
            self.may_have_late_replies = True
            raise self._error(command, f"it took {taken} of {len(data)} bytes", CABLE)

    def drain(
        self, command: str, endpoint: int, length: int, quiet: float, is_overdue: Callable[[], bool]
    ) -> int:
        """Read and forget what comes until nothing has for `quiet` seconds; how many reports.

        DeviceError if it goes on when it's `is_overdue`, or if the device has gone.
        """
        import usb.core

        self.open(command)
        count = 0
        while True:
            try:
                with self._translate_errors(command, quiet, endpoint, usb.core.USBTimeoutError):
                    self._device.read(endpoint, length, max(round(quiet * 1000), 1))
            except usb.core.USBTimeoutError:
                return count
            count += 1
            self._require_not_cancelled(command)
            if is_overdue():
                raise self._error(command, "it doesn't stop sending", CABLE)

    def _transfer(
        self,
        command: str,
        transfer: Callable[[Any, int], Any],
        seconds: float | None,
        endpoint: int = 0,
    ) -> Any:
        """transfer: of a device of pyusb's, with a time-out in milliseconds."""
        self.open(command)
        seconds = self.timeout if seconds is None else min(max(seconds, 0.0), self.timeout)
        with self._translate_errors(command, seconds, endpoint):
            # 0 would be for ever.
            answer = transfer(self._device, max(round(seconds * 1000), 1))
        self._require_not_cancelled(command)
        return answer

    def _require_not_cancelled(self, command: str) -> None:
        """DeviceError once the device was given up: whoever opens it anew must find it free."""
        if self._cancelled.is_set():
            self.close()
            raise self._error(command, "the device was given up", "Open the device again")

    def _find(self, command: str) -> Any:
        import usb.core

        found = usb.core.find(
            find_all=True, backend=self._backend, idVendor=self._vendor, idProduct=self._product
        )
        which = f"{self._vendor:04x}:{self._product:04x}"
        devices = list(found)
        if self._serial:
            which += f" with serial number {self._serial}"
            devices = self._with_serial(devices)
        if not devices:
            raise self._error(
                command, f"no USB device {which} is there", "Plug it in, and switch it on"
            )
        if len(devices) > 1:
            raise self._error(
                command,
                f"{len(devices)} USB devices {which} are there",
                "Give the serial number in the option serial, or unplug the others",
            )
        return devices[0]

    def _count_matching(self) -> int:
        """How many devices of this kind the system knows of; none is opened."""
        return sum(
            (told.idVendor, told.idProduct) == (self._vendor, self._product)
            for told in map(self._backend.get_device_descriptor, self._backend.enumerate_devices())
        )

    def _with_serial(self, devices: list[Any]) -> list[Any]:
        """Those of the wanted serial number; what hinders reading it matters only if none is."""
        import usb.core
        import usb.util

        fitting, hindrance = [], None
        for device in devices:
            try:
                if read_string(device, device.iSerialNumber) == self._serial:
                    fitting.append(device)
                    continue
            except (usb.core.USBError, ValueError) as error:
                hindrance = error
            usb.util.dispose_resources(device)
        if not fitting and hindrance is not None:
            raise hindrance
        return fitting

    def _claim(self) -> None:
        import usb.core
        import usb.util

        device = self._device
        with contextlib.suppress(NotImplementedError):
            if device.is_kernel_driver_active(self._interface):
                device.detach_kernel_driver(self._interface)
                self._kernel_driver_detached = True
        try:
            device.get_active_configuration()
        except usb.core.USBError as error:
            if error.errno is not None:
                raise
            # It has none yet. Setting the one that is in force would reset the device.
            device.set_configuration()
        usb.util.claim_interface(device, self._interface)

    def _require_same_device(self, command: str) -> None:
        known = self._first_identity
        told = self._read_identity(twice=known is None)
        if (
            known is not None
            and told != known
            and (told := self._read_identity(twice=True)) != known
        ):
            raise self._error(
                command,
                f"another device has taken its place: {describe_identity(told)} where "
                f"{describe_identity(known)} was",
                "Plug the right one in, or open the bench again",
            )
        self._first_identity = told

    def _read_identity(self, twice: bool) -> UsbIdentity:
        device = self._device
        indices = (device.iManufacturer, device.iProduct, device.iSerialNumber)
        maker, product, serial = (read_string(device, index, twice) for index in indices)
        release = f"{device.bcdDevice >> 8:x}.{device.bcdDevice & 0xFF:02x}"
        return UsbIdentity(maker, product, serial, release)

    @contextlib.contextmanager
    def _translate_errors(
        self,
        command: str,
        seconds: float,
        endpoint: int = 0,
        let_through: type[Exception] | tuple[()] = (),
    ) -> Iterator[None]:
        """Make a DeviceError of whatever pyusb raises, but for what is `let_through` on."""
        try:
            yield
        except DeviceError:
            self.may_have_late_replies = True
            self.close()
            raise
        except let_through:
            raise
        except Exception as error:
            self.may_have_late_replies = True
            self._require_not_cancelled(command)
            code = getattr(error, "errno", None)
            if code == errno.EPIPE and endpoint and self._device is not None:
                with contextlib.suppress(Exception):
                    self._device.clear_halt(endpoint)
            if code not in (errno.ETIMEDOUT, errno.EPIPE):
                self.close()
            words = explain_usb_error(error, seconds, self._vendor, self._product)
            raise self._error(command, *words) from error

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self._model, command, reply, remedy)
