"""What is plugged into this computer: the names that a bench file wants."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Port:
    """A port, device, camera or screen, by the address that a driver opens it with."""

    kind: str
    address: str
    description: str


def serial_ports() -> list[Port]:
    """The serial ports, as pyserial lists them."""
    from serial.tools import list_ports

    return [Port("serial", p.device, p.description or "") for p in list_ports.comports()]


def usb_devices() -> list[Port]:
    """The USB devices, as vendor:product, through the libusb that is installed with us."""
    import libusb_package
    import usb.core

    found = usb.core.find(find_all=True, backend=libusb_package.get_libusb1_backend())
    return [
        Port("USB", f"{d.idVendor:04x}:{d.idProduct:04x}", f"bus {d.bus} device {d.address}")
        for d in found or []
    ]


def cameras() -> list[Port]:
    """GigE Vision and USB3 Vision cameras that answer, which takes a second.

    DeviceError where Aravis isn't installed.
    """
    from drivers.aravis import find_cameras

    return [
        Port(one["protocol"], one["id"], " ".join((one["vendor"], one["model"], one["address"])))
        for one in find_cameras()
    ]


def screens() -> list[Port]:
    """The screens of this session's X server; none where there is no X server.

    DeviceError where there is one that can't be asked.
    """
    import os

    from drivers.screen import list_screens as lit

    if not os.environ.get("DISPLAY"):
        return []
    return [
        Port("screen", one.name, f"{one.width}x{one.height}, {one.monitor.model or 'no EDID'}")
        for one in lit()
    ]
