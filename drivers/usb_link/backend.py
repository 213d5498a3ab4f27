"""Through what pyusb reaches a device: the libusb that is installed with us, or another backend.

Option `backend` of every USB driver: empty for libusb. "module:name" is a pyusb backend, or what
gives one when it's called; "module:name@address" is called with the address. A simulated device
is plugged in this way, and the driver knows nothing of it.
"""

from __future__ import annotations

import pkgutil
import re
from typing import Any

_CORRECT = "Correct the option backend, or leave it out for libusb"

_NAME = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*(@.+)?")


def require_backend_name(backend: object) -> None:
    """ValueError for what is no name of a backend."""
    if not isinstance(backend, str) or (backend and not _NAME.fullmatch(backend)):
        raise ValueError(
            f'backend is {backend!r}; leave it empty for libusb, or give "module:name" or '
            '"module:name@address" of a pyusb backend'
        )


class BackendMissing(Exception):
    """There is no such backend. remedy: what helps."""

    def __init__(self, reply: str, remedy: str) -> None:
        super().__init__(reply)
        self.remedy = remedy


def load_backend(backend: str) -> Any:
    """The backend of that name; BackendMissing if there is none."""
    if not backend:
        return _libusb()
    name, _, address = backend.partition("@")
    try:
        thing = pkgutil.resolve_name(name)
    except (ImportError, AttributeError, ValueError) as error:
        reply = f"the backend {name} can't be loaded ({error})"
        raise BackendMissing(reply, _CORRECT) from error
    try:
        if address:
            return thing(address)
        return thing() if callable(thing) else thing
    except Exception as error:
        raise BackendMissing(f"the backend {backend} doesn't start ({error})", _CORRECT) from error


def _libusb() -> Any:
    try:
        import libusb_package
    except ImportError as error:
        reply = "pyusb has no backend"
        raise BackendMissing(
            reply, "Install the package libusb-package, which brings libusb"
        ) from error
    backend = libusb_package.get_libusb1_backend()
    if backend is None:
        reply = "pyusb has no backend: the libusb of libusb-package can't be loaded"
        raise BackendMissing(reply, "Reinstall the package libusb-package")
    return backend
