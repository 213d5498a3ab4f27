"""Choose the pyusb backend of a device: the libusb of libusb-package, or an installed one.

Every USB driver has the option `backend`. An empty text means libusb. "NAME" or "NAME@ADDRESS" is
an entry point of an installed package, in the group "labapp.usb_backends": a function that returns
a pyusb backend, and is called with the address if there is one. No text names code in another way,
since it may come from a stranger's file; scripts give the function itself. Simulated devices are
connected in this way, without any change of the driver.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from typing import Any

GROUP = "labapp.usb_backends"

_CORRECT = "Correct the option backend, or leave it out for libusb"

_NAME = re.compile(r"[\w.-]+(@.+)?")

Backend = str | Callable[[], Any]
"""Name of an installed pyusb backend with its address, or a function that returns one."""


def require_backend_name(backend: object) -> None:
    """Raise ValueError unless the option `backend` is empty, a function or an installed name."""
    if callable(backend) or backend == "":
        return
    named = isinstance(backend, str) and _NAME.fullmatch(backend) is not None
    installed = _installed_backends()
    if not (named and str(backend).partition("@")[0] in installed.names):
        known = ", ".join(sorted(installed.names)) or "none"
        raise ValueError(
            f'backend is {backend!r}; leave it empty for libusb, or give "NAME" or "NAME@ADDRESS" '
            f"of an installed backend: {known}"
        )


class BackendMissing(Exception):
    """Raised when a pyusb backend can't be loaded. remedy: what to try."""

    def __init__(self, reply: str, remedy: str) -> None:
        super().__init__(reply)
        self.remedy = remedy


def load_backend(backend: Backend) -> Any:
    """Return the pyusb backend of that name, or raise BackendMissing."""
    if not backend:
        return _libusb()
    try:
        if not isinstance(backend, str):
            return backend()
        name, _, address = backend.partition("@")
        installed = _installed_backends()
        if name not in installed.names:
            raise LookupError("it isn't installed")
        entry = installed[name]
        make = entry.load()
        return make(address) if address else make()
    except Exception as error:
        raise BackendMissing(f"the backend {backend} doesn't start ({error})", _CORRECT) from error


@cache
def _installed_backends() -> EntryPoints:
    """Return the entry points of backends, for which all packages are looked at."""
    return entry_points(group=GROUP)


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
