"""Through what pyusb reaches a device: the libusb that is installed with us, or another backend.

Option `backend` of every USB driver: empty for libusb. "module:name" is a pyusb backend, or what
gives one when it's called; "module:name@address" is called with the address. A simulated device
is plugged in this way, and the driver knows nothing of it.
"""

from __future__ import annotations

import pkgutil
import re
from typing import Any

_NAME = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*(@.+)?")


def require_backend_name(backend: object) -> None:
    """ValueError for what is no name of a backend."""
    if not isinstance(backend, str) or (backend and not _NAME.fullmatch(backend)):
        raise ValueError(
            f'backend is {backend!r}; leave it empty for libusb, or give "module:name" or '
            '"module:name@address" of a pyusb backend'
        )


def load_backend(backend: str) -> Any:
    """The backend of that name; RuntimeError says what is missing."""
    if not backend:
        return _libusb()
    name, _, address = backend.partition("@")
    try:
        thing = pkgutil.resolve_name(name)
    except (ImportError, AttributeError, ValueError) as error:
        raise RuntimeError(f"the backend {name} can't be loaded ({error})") from error
    if address:
        return thing(address)
    return thing() if callable(thing) else thing


def _libusb() -> Any:
    try:
        import libusb_package
    except ImportError as error:
        raise RuntimeError(
            "pyusb has no backend: install the package libusb-package, which brings libusb"
        ) from error
    backend = libusb_package.get_libusb1_backend()
    if backend is None:
        raise RuntimeError(
            "pyusb has no backend: the libusb of the package libusb-package can't be loaded; "
            "reinstall that package"
        )
    return backend
