"""A USB device on its wire: found, claimed, asked in time, and found again after unplugging.

pyusb with the libusb of the package libusb-package; sources: pyusb's tutorial and libusb's
documentation of its synchronous transfers.
"""

from __future__ import annotations

from drivers.usb_link.link import UsbLink

__all__ = ["UsbLink"]
