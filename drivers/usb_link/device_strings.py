"""What a USB device says of itself."""

from __future__ import annotations

import errno
from typing import Any, NamedTuple


class UsbIdentity(NamedTuple):
    """What a USB device says of itself: strings, empty where it has none, and its release."""

    maker: str
    product: str
    serial: str
    release: str


_ENGLISH = 0x0409


STRING_TIMEOUT = 0.5
"""Seconds that the USB specification allows for a string."""


def read_string(device: Any, index: int, twice: bool = True) -> str:
    """A string of a device, empty where it has none.

    ValueError if it is none, or, asked twice, another one the second time.
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
        told = bytes(device.ctrl_transfer(0x80, 6, 0x0300 | index, _ENGLISH, 254, timeout))
    except usb.core.USBError as error:
        # Some devices number strings that they don't have.
        if error.errno == errno.EPIPE:
            return b""
        raise
    if len(told) < 2 or told[1] != 3 or not 2 <= told[0] <= len(told):
        raise ValueError(f"it says {told.hex(' ') or 'nothing'} of itself, which is no string")
    return told[2 : told[0] & 0xFE]


def describe_identity(identity: UsbIdentity) -> str:
    """Who it is, for a person."""
    number = f"serial number {identity.serial}" if identity.serial else "no serial number"
    return f"{identity.product or 'a device without a name'} ({number}, release {identity.release})"
