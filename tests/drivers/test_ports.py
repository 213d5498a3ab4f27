import sys
from types import SimpleNamespace

import pytest

from drivers.ports import Port, serial_ports, usb_devices


def test_serial_ports_are_listed_as_pyserial_sees_them(monkeypatch):
    found = [
        SimpleNamespace(device="/dev/ttyUSB0", description="VariSpec"),
        SimpleNamespace(device="/dev/ttyS0", description=None),
    ]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
    assert serial_ports() == [
        Port("serial", "/dev/ttyUSB0", "VariSpec"),
        Port("serial", "/dev/ttyS0", ""),
    ]


@pytest.mark.parametrize("nothing", [None, []])
def test_usb_devices_are_listed_by_vendor_and_product(monkeypatch, nothing):
    """1278:0920 is the Starlight Xpress filter wheel's address, with leading zeros kept."""
    wheel = SimpleNamespace(idVendor=0x1278, idProduct=0x0920, bus=1, address=4)
    fake = SimpleNamespace(get_libusb1_backend=lambda: "backend")
    monkeypatch.setitem(sys.modules, "libusb_package", fake)
    seen = {}

    def find(**options):
        seen.update(options)
        return seen["answer"]

    import usb.core

    monkeypatch.setattr(usb.core, "find", find)
    seen["answer"] = [wheel]
    assert usb_devices() == [Port("USB", "1278:0920", "bus 1 device 4")]
    assert seen["backend"] == "backend"
    seen["answer"] = nothing
    assert usb_devices() == []
