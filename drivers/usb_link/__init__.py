"""Link to a USB device: finding, claiming, transfers with timeouts, and reopening after unplugging.

It uses pyusb with the libusb of the package libusb-package. Sources: pyusb's tutorial and libusb's
documentation of its synchronous transfers.
"""

from __future__ import annotations

from drivers.usb_link.link import UsbLink

__all__ = ["UsbLink"]
