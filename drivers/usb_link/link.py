"""One USB device, whose every failure is reported as a DeviceError."""

from __future__ import annotations

import contextlib
import errno
import threading
from collections.abc import Callable, Iterator
from typing import Any

from drivers.device_holders import name_holders
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
    """Exchange data with one device, found by vendor and product and perhaps by serial number.

    Every failure is a DeviceError, which is raised at most `timeout` seconds after the beginning of
    a transfer. Opening the device, if needed, takes at most 3 seconds more. A device that was
    unplugged is opened again by the next call; if another device answers then, that is a
    DeviceError, too.

    Parameters
    ----------
    model : str
        The device's name in errors.
    vendor, product : int
        Vendor and product ID of the device.
    serial : str, default ""
        Serial number, needed if several such devices are plugged in.
    backend : str, default ""
        Name of an installed pyusb backend, or a function that returns one; empty for libusb. See
        drivers.usb_link.backend.
    interface : int, default 0
        Number of the interface that is claimed.
    timeout : float, default 1.0
        Longest time of a transfer in seconds.

    Raises
    ------
    ValueError
        If `serial` isn't a string, or `backend` doesn't have the form of a backend's name.
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
        """Whether a call has failed since the driver last set this to False.

        Replies to earlier queries may then still arrive.
        """
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
        """What the device reported of itself when it was first opened."""
        return self._first_identity or UsbIdentity("", "", "", "")

    @property
    def is_open(self) -> bool:
        return self._device is not None

    @property
    def is_cancelled(self) -> bool:
        """Whether cancel() was called, after which no transfer is possible any more."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Let no further transfer begin; any thread may call this.

        The thread that uses the link then closes the device.
        """
        self._cancelled.set()

    def open(self, command: str = "open") -> None:
        """Find and claim the device, unless it is open already."""
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
        """Return why the device counts as unplugged, empty while it is there.

        It looks only at the system's list of USB devices and sends nothing. It returns None before
        the device was found. Any thread may call it.
        """
        if self._backend is None or not self._matching_count:
            return None
        try:
            there = self._count_matching()
        except Exception:
            return None
        return "" if there >= self._matching_count else "it was unplugged"

    def close(self) -> None:
        """Release the device to the system; this never raises."""
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
        """Send a control transfer; DeviceError unless the device takes all bytes."""
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
        """Fetch up to `length` bytes by a control transfer."""
        given = (request_type, request, value, self._interface, length)
        return bytes(
            self._transfer(command, lambda one, ms: one.ctrl_transfer(*given, ms), seconds)
        )

    def read(self, command: str, endpoint: int, length: int, seconds: float | None = None) -> bytes:
        """Read up to `length` bytes from a bulk or interrupt endpoint.

        If the endpoint has halted, the halt is cleared and DeviceError is raised.
        """
        return bytes(
            self._transfer(
                command, lambda one, ms: one.read(endpoint, length, ms), seconds, endpoint
            )
        )

    def write(self, command: str, endpoint: int, data: bytes, seconds: float | None = None) -> None:
        """Write all bytes to a bulk or interrupt endpoint."""
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
        """Discard reports until none comes for `quiet` seconds; count them.

        Raises DeviceError if reports still come when `is_overdue()` is true, or if the device is
        gone.
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
        """Carry out a transfer within `seconds` and the link's timeout.

        transfer: function of pyusb's device and a timeout in milliseconds.
        """
        self.open(command)
        seconds = self.timeout if seconds is None else min(max(seconds, 0.0), self.timeout)
        with self._translate_errors(command, seconds, endpoint):
            # For libusb a timeout of 0 means no limit.
            answer = transfer(self._device, max(round(seconds * 1000), 1))
        self._require_not_cancelled(command)
        return answer

    def _require_not_cancelled(self, command: str) -> None:
        """Raise DeviceError if cancel() was called, and close to free the device."""
        if self._cancelled.is_set():
            self.close()
            raise self._error(command, "the device was given up", "Open the device again")

    def _find(self, command: str) -> Any:
        """Find the device by vendor, product and serial number, or raise DeviceError."""
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
        """Count the devices that match vendor and product, without opening any."""
        return sum(
            (told.idVendor, told.idProduct) == (self._vendor, self._product)
            for told in map(self._backend.get_device_descriptor, self._backend.enumerate_devices())
        )

    def _with_serial(self, devices: list[Any]) -> list[Any]:
        """Return the devices with the required serial number.

        An error when reading a serial number is raised only if no device matches.
        """
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
        """Claim the interface; detach the system's driver if needed."""
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
            # The device has no configuration yet. The present one isn't set again, because that
            # would reset the device.
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
        """Turn pyusb's exceptions into DeviceError, except any of `let_through`."""
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
            who = self._name_holders() if code == errno.EBUSY else ""
            if code not in (errno.ETIMEDOUT, errno.EPIPE):
                self.close()
            if who:
                raise self._error(command, f"it is in use by {who}", "Close that first") from error
            words = explain_usb_error(error, seconds, self._vendor, self._product)
            raise self._error(command, *words) from error

    def _name_holders(self) -> str:
        """Return who else has the device open, in words; empty if nobody is known to."""
        if self._backend_name or self._device is None:
            return ""
        return name_holders(f"/dev/bus/usb/{self._device.bus:03d}/{self._device.address:03d}")

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self._model, command, reply, remedy)
