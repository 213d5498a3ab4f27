"""A bus of simulated USB devices, as a backend of pyusb that unmodified drivers can use.

A driver's option backend = "simulated-here@NAME" calls bus(NAME). Source: pyusb's
usb.backend.IBackend.
"""

from __future__ import annotations

import array
import errno
from abc import ABC, abstractmethod
from types import SimpleNamespace
from typing import Any

from drivers.interfaces import Clock
from simulator.machines.usb import SetupPacket, UsbMachine
from simulator.wire.usb_plug import Plug, device_descriptor, usb_error

Handle = tuple[int, int]
"""Port and address of an open USB device. After unplugging, the address is no longer valid."""

_buses: dict[str, UsbBus] = {}


def register_bus(name: str, bus: UsbBus) -> str:
    """Register a bus in this process; return drivers' option `backend`."""
    _buses[name] = bus
    return f"simulated-here@{name}"


def unregister_bus(name: str) -> None:
    _buses.pop(name, None)


def bus(name: str) -> UsbBus:
    """Return the bus that has this name, or raise LookupError."""
    if name not in _buses:
        raise LookupError(f"no simulated USB bus {name!r} is in this process")
    return _buses[name]


class SimulatedUsbBackend(ABC):
    """Base of the USB backends: implements the transfers of pyusb's IBackend by three methods."""

    @abstractmethod
    def control(self, handle: Handle, setup: SetupPacket, data: bytes, timeout: int) -> bytes:
        """Carry out a control transfer.

        The timeout is in milliseconds, as in the methods below.
        """

    @abstractmethod
    def read(self, handle: Handle, endpoint: int, length: int, timeout: int) -> bytes: ...

    @abstractmethod
    def write(self, handle: Handle, endpoint: int, data: bytes, timeout: int) -> int: ...

    def get_parent(self, dev: int) -> None:  # noqa: B027
        """Return None, since every device hangs at the root hub."""

    def close_device(self, dev_handle: Handle) -> None:  # noqa: B027
        """Do nothing, since an open device holds no resources."""

    def ctrl_transfer(
        self,
        dev_handle: Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: array.array[int],
        timeout: int,
    ) -> int:
        given = data.tobytes()
        setup = SetupPacket(bmRequestType, bRequest, wValue, wIndex, len(given))
        incoming = bmRequestType & 0x80
        answer = self.control(dev_handle, setup, b"" if incoming else given, timeout)
        return _copy_into(data, answer) if incoming else len(given)

    def intr_read(
        self, dev_handle: Handle, ep: int, intf: int, buff: array.array[int], timeout: int
    ) -> int:
        return _copy_into(buff, self.read(dev_handle, ep, len(buff), timeout))

    def intr_write(
        self, dev_handle: Handle, ep: int, intf: int, data: array.array[int], timeout: int
    ) -> int:
        return self.write(dev_handle, ep, data.tobytes(), timeout)

    bulk_read = iso_read = intr_read
    bulk_write = iso_write = intr_write


class UsbBus(SimulatedUsbBackend):
    """Simulate a USB bus: plugs by port, with waiting by the bench's clock."""

    def __init__(self, clock: Clock, seed: int = 0) -> None:
        self._clock, self._seed = clock, seed
        self._plugs: dict[int, Plug] = {}

    def plug_in(self, machine: UsbMachine) -> Plug:
        """Plug a machine into the next free port; return the plug, which controls its faults."""
        port = len(self._plugs) + 1
        plug = Plug(machine, self._clock, self._seed * 1000 + port)
        self._plugs[port] = plug
        return plug

    def enumerate_devices(self) -> list[int]:
        return [port for port, plug in self._plugs.items() if plug.update_presence()]

    def get_device_descriptor(self, dev: int) -> SimpleNamespace:
        plug = self._plugs[dev]
        return device_descriptor(plug.description, dev, plug.address)

    def get_configuration_descriptor(self, dev: int, config: int) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=_first_only(config, 9), bDescriptorType=2, wTotalLength=0, bNumInterfaces=1,
            bConfigurationValue=1, iConfiguration=0, bmAttributes=0x80, bMaxPower=50,
            extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(
        self, dev: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        description = self._plugs[dev].description
        return SimpleNamespace(
            bLength=_first_only(max(intf, alt, config), 9), bDescriptorType=4, bInterfaceNumber=0,
            bAlternateSetting=0, bNumEndpoints=len(description.endpoints),
            bInterfaceClass=description.interface_class, bInterfaceSubClass=0,
            bInterfaceProtocol=0, iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(
        self, dev: int, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        endpoint = self._plugs[dev].description.endpoints[ep]
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=endpoint.address,
            bmAttributes=endpoint.attributes, wMaxPacketSize=endpoint.size,
            bInterval=endpoint.interval, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: int) -> Handle:
        plug = self._plugs[dev]
        plug.require_plugged_in()
        if plug.denied:
            raise usb_error(errno.EACCES)
        return dev, plug.address

    def set_configuration(self, dev_handle: Handle, *given: int) -> None:
        """Check that the device is plugged in; there is nothing to configure."""
        self._plug(dev_handle)

    set_interface_altsetting = release_interface = clear_halt = set_configuration

    def get_configuration(self, dev_handle: Handle) -> int:
        self._plug(dev_handle)
        return 1

    def claim_interface(self, dev_handle: Handle, intf: int) -> None:
        plug = self._plug(dev_handle)
        if plug.busy or plug.kernel_driver:
            raise usb_error(errno.EBUSY)

    def is_kernel_driver_active(self, dev_handle: Handle, intf: int) -> bool:
        return self._plug(dev_handle).kernel_driver

    def detach_kernel_driver(self, dev_handle: Handle, intf: int) -> None:
        self._plug(dev_handle).kernel_driver = False

    def attach_kernel_driver(self, dev_handle: Handle, intf: int) -> None:
        self._plug(dev_handle).kernel_driver = True

    def reset_device(self, dev_handle: Handle) -> None:
        self._plug(dev_handle).machine.power_up(self._clock.now())

    def control(self, handle: Handle, setup: SetupPacket, data: bytes, timeout: int) -> bytes:
        return self._plug(handle).control(setup, data, timeout * 1e-3)

    def read(self, handle: Handle, endpoint: int, length: int, timeout: int) -> bytes:
        return self._plug(handle).read(endpoint, length, timeout * 1e-3)

    def write(self, handle: Handle, endpoint: int, data: bytes, timeout: int) -> int:
        return self._plug(handle).write(endpoint, data, timeout * 1e-3)

    def _plug(self, handle: Handle) -> Plug:
        """Return the plug of an open device, if it is still there."""
        port, address = handle
        plug = self._plugs[port]
        plug.require_plugged_in()
        if plug.address != address:
            raise usb_error(errno.ENODEV)
        return plug


def _first_only(index: Any, value: int) -> int:
    """Return a descriptor's value if the index is 0.

    Any other index raises IndexError, which ends pyusb's lists.
    """
    if index:
        raise IndexError
    return value


def _copy_into(buffer: array.array[int], data: bytes) -> int:
    """Copy bytes into pyusb's buffer, and return their number."""
    buffer[: len(data)] = array.array(buffer.typecode, data)
    return len(data)
