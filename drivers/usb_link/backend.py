"""Choice of the pyusb backend of a USB driver: the libusb of libusb-package, or another one.

Every USB driver has the option `backend`. An empty string means libusb. "module:name" is a pyusb
backend or a function that returns one; with "module:name@address" the function is called with the
address. Simulated devices are connected in this way, without any change of the driver.
"""

from __future__ import annotations

import pkgutil
import re
from typing import Any

_CORRECT = "Correct the option backend, or leave it out for libusb"

_NAME = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*(@.+)?")


def require_backend_name(backend: object) -> None:
    """Raise ValueError unless the USB link's option `backend` has the form of a backend's name."""
    if not isinstance(backend, str) or (backend and not _NAME.fullmatch(backend)):
        raise ValueError(
            f'backend is {backend!r}; leave it empty for libusb, or give "module:name" or '
            '"module:name@address" of a pyusb backend'
        )


class BackendMissing(Exception):
    """Raised when a pyusb backend can't be loaded. remedy: what to try."""

    def __init__(self, reply: str, remedy: str) -> None:
        super().__init__(reply)
        self.remedy = remedy


def load_backend(backend: str) -> Any:
    """Return the pyusb backend of that name for a USB link, or raise BackendMissing."""
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
