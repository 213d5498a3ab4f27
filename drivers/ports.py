"""What is plugged into this computer: the names that a bench file wants."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Port:
    """A serial port or a USB device, by the address that a driver opens it with."""

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
