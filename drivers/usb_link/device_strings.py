"""What a device says of itself in its string descriptors."""

from __future__ import annotations

import errno
from typing import Any, NamedTuple


class UsbIdentity(NamedTuple):
    """A device's strings, empty if it has none, and its release number."""

    maker: str
    product: str
    serial: str
    release: str


STRING_TIMEOUT = 0.5
"""Seconds that the USB specification allows for reading a string."""


def read_string(device: Any, index: int, twice: bool = True) -> str:
    """Read a string descriptor; empty if the device has none.

    twice: whether it is read a second time for comparison. Raises ValueError for a reply that is no
    string and for two replies that differ.
    """
    if not index:
        return ""
    once = _string_bytes(device, index)
    again = _string_bytes(device, index) if twice else once
    if once != again:
        raise ValueError(f"it says {once.hex(' ')} and then {again.hex(' ')} of itself")
    return once.decode("utf-16-le", errors="replace").strip("\0 ")


def _string_bytes(device: Any, index: int) -> bytes:
    import usb.core

    timeout = round(STRING_TIMEOUT * 1000)
    try:
        # GET_DESCRIPTOR of a string, in US English (0x0409).
        told = bytes(device.ctrl_transfer(0x80, 6, 0x0300 | index, 0x0409, 254, timeout))
    except usb.core.USBError as error:
        # Some devices give an index for strings that they don't have.
        if error.errno == errno.EPIPE:
            return b""
        raise
    if len(told) < 2 or told[1] != 3 or not 2 <= told[0] <= len(told):
        raise ValueError(f"it says {told.hex(' ') or 'nothing'} of itself, which is no string")
    return told[2 : told[0] & 0xFE]


def describe_identity(identity: UsbIdentity) -> str:
    """Name a device by its product, serial number and release."""
    number = f"serial number {identity.serial}" if identity.serial else "no serial number"
    return f"{identity.product or 'a device without a name'} ({number}, release {identity.release})"
