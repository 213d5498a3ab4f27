"""Find and claim a USB device, transfer with timeouts, and reopen it after unplugging.

It uses pyusb with the libusb of the package libusb-package. Sources: pyusb's tutorial and libusb's
documentation of its synchronous transfers.
"""

from __future__ import annotations

from drivers.usb_link.link import UsbLink

__all__ = ["UsbLink"]
