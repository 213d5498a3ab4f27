"""What is connected to this computer, with the names that a bench file takes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Port:
    """A connected device, camera or screen, or a serial port, with the address to open it by."""

    kind: str
    address: str
    description: str


def serial_ports() -> list[Port]:
    """List the serial ports that pyserial finds."""
    from serial.tools import list_ports

    return [Port("serial", p.device, p.description or "") for p in list_ports.comports()]


def usb_devices() -> list[Port]:
    """List the USB devices as vendor:product.

    They are found with the libusb of the package libusb-package.
    """
    import libusb_package
    import usb.core

    found = usb.core.find(find_all=True, backend=libusb_package.get_libusb1_backend())
    return [
        Port("USB", f"{d.idVendor:04x}:{d.idProduct:04x}", f"bus {d.bus} device {d.address}")
        for d in found or []
    ]


def cameras() -> list[Port]:
    """List the GigE Vision and USB3 Vision cameras that answer; takes a second.

    Raises DeviceError if Aravis isn't installed.
    """
    from drivers.aravis import find_cameras

    return [
        Port(one["protocol"], one["id"], " ".join((one["vendor"], one["model"], one["address"])))
        for one in find_cameras()
    ]


def screens() -> list[Port]:
    """List the screens of this session's X server; empty without a server.

    Raises DeviceError if the X server can't be asked.
    """
    import os

    from drivers.screen import list_screens as lit

    if not os.environ.get("DISPLAY"):
        return []
    return [
        Port("screen", one.name, f"{one.width}x{one.height}, {one.monitor.model or 'no EDID'}")
        for one in lit()
    ]
