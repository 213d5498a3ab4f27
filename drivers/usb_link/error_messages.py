"""What libusb's errors mean, and what to do about them."""

from __future__ import annotations

import errno

from drivers.usb_link.backend import BackendMissing

CABLE = "Check its cable, and pull its plug and put it in again if it stays"

_EXPLANATIONS: dict[int | None, tuple[str, str]] = {
    errno.ETIMEDOUT: ("no answer within {seconds:.2g} s", CABLE),
    errno.EPIPE: ("it refuses the command (stall)", CABLE),
    errno.ENODEV: ("it was unplugged", "Plug it in again"),
    errno.ENOENT: ("it was unplugged", "Plug it in again"),
    errno.EBUSY: ("another program uses it", "End the other program"),
    errno.EIO: ("the transfer failed (input/output error)", CABLE),
    errno.EOVERFLOW: ("it sent more than it was asked for", CABLE),
}


def explain_usb_error(
    error: Exception, seconds: float, vendor: int, product: int
) -> tuple[str, str]:
    """Return what an exception of pyusb means, and its remedy.

    seconds: timeout of the transfer.
    """
    if isinstance(error, BackendMissing):
        return str(error), error.remedy
    code = getattr(error, "errno", None)
    if code in (errno.EACCES, errno.EPERM):
        return "the system denies access to it", udev_rule(vendor, product)
    known = _EXPLANATIONS.get(code)
    if known is None and isinstance(error, ValueError):
        return str(error), CABLE
    if known is None:
        return f"{type(error).__name__}: {error}", CABLE
    reply, remedy = known
    return reply.format(seconds=seconds), remedy


def udev_rule(vendor: int, product: int) -> str:
    """Return the instruction for a udev rule that lets users open a device."""
    return (
        "Write into /etc/udev/rules.d/70-labapp.rules the line "
        f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}", '
        'MODE="0660", TAG+="uaccess" and plug the device in again'
    )
