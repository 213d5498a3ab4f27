"""Locks, so that only one application of the user at a time uses a device.

Other users' applications aren't kept out by this, but by the lock of the device itself: that of the
serial port, the claim of the USB interface, or the control of the camera, which drivers take.
A device has the same names however a bench file addresses it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.device_holders import name_process
from drivers.errors import DeviceError
from drivers.interfaces import Identity
from labapp.common.errors import UserError
from labapp.common.named_locks import find_lock_holder, take_named_lock
from labapp.files.bench_file import DeviceTable

_ADDRESSES = frozenset(
    ("address", "backend", "device", "display", "host", "index", "port", "screen", "serial")
)
"""Driver options that identify a device. A device without any is identified by all its options."""

_DEFAULT_FILES = {"varispec": ("port", "/dev/ttyUSB0"), "uvc-camera": ("device", "/dev/video0")}
"""Device files that drivers open if the option isn't given: as in their signatures."""

_LINK_FOLDERS = ("/dev/serial/by-id", "/dev/v4l/by-id")
"""Folders with links from a device's name and serial number to the file that it has now."""


def device_names(table: DeviceTable) -> tuple[str, ...]:
    """Return the names of a device on this computer.

    Two benches use the same device if they have a name in common. A device file has its own name
    whatever link or driver leads to it, and its name and serial number, which it keeps when it is
    plugged in again.
    """
    file = _device_file(table)
    if file is not None:
        path = os.path.realpath(file)
        return (path, *_lasting_names(path))
    if table.driver == "screen-slm":
        return (_screen_name(table.options),)
    where = {name: told for name, told in table.options.items() if name in _ADDRESSES}
    return (json.dumps([table.driver, where or table.options], sort_keys=True, default=str),)


def _device_file(table: DeviceTable) -> str | None:
    """Return the path of the file in /dev by which a device is opened, if there is one."""
    option, default = _DEFAULT_FILES.get(table.driver, ("", ""))
    given = [table.options[name] for name in ("port", "device") if name in table.options]
    if not given and option:
        given = [default]
    for value in given:
        if table.driver == "uvc-camera" and isinstance(value, int):
            return f"/dev/video{value}"
        if isinstance(value, str) and value.startswith("/"):
            return value
    return None


def _lasting_names(path: str) -> Iterator[str]:
    """Yield the links that name a device by its maker and serial number."""
    for folder in map(Path, _LINK_FOLDERS):
        if folder.is_dir():
            for link in sorted(folder.iterdir()):
                if os.path.realpath(link) == path:
                    yield str(link)


def _screen_name(options: dict[str, Any]) -> str:
    """Return the name of the screen that an SLM is: its X server and output."""
    display = str(options.get("display") or os.environ.get("DISPLAY", ""))
    server, _, number = display.rpartition(":")
    place = f"{server.removeprefix('unix')}:{number.partition('.')[0]}"
    return f"screen {_output_name(display, options)} of {place}"


def _output_name(display: str, options: dict[str, Any]) -> str:
    """Return the output of an X server that an SLM's options choose.

    If the X server can't tell, the SLM won't open; then it's the option itself.
    """
    from drivers.screen.screen_choice import ScreenRequest, choose_screen
    from drivers.x11 import XConnection, XError
    from drivers.x11.outputs import list_outputs

    size = options.get("width", 1920), options.get("height", 1080)
    asked = str(options.get("screen", ""))
    try:
        with XConnection(display) as x:
            there = [replace(output, refresh=0.0) for output in list_outputs(x)]
        primary = bool(options.get("allow_primary", False))
        return choose_screen(ScreenRequest(asked, *size, 60.0, primary), there).name
    except (XError, DeviceError, OSError, TypeError, ValueError):
        return asked


log = logging.getLogger(__name__)

_PREFIX = "labapp-device"
"""What the names of the locks begin with."""


@contextmanager
def lock_devices(tables: Mapping[str, DeviceTable]) -> Iterator[None]:
    """Lock real devices for this process, among the user's, while the block runs.

    Simulated devices need no lock, because each application creates its own. The operating system
    releases the locks of a process that dies. Raises UserError if another application of the user's
    uses a device; the message names it.

    tables: device tables of the bench file, by the devices' names.
    """
    with ExitStack() as stack:
        for role, table in tables.items():
            if table.is_exclusive:
                for name in device_names(table):
                    stack.enter_context(_lock(name, f"the {role} ({table.driver})"))
        yield


@contextmanager
def lock_serial_number(role: str, table: DeviceTable, identity: Identity) -> Iterator[None]:
    """Lock an open device by its serial number, while the block runs.

    Another application may have it open by another address. Raises UserError if one has.
    """
    # Makers of webcams give all of a model the same number.
    if not (table.is_exclusive and identity.serial) or table.driver == "uvc-camera":
        yield
        return
    if identity.simulated or table.simulated:
        yield
        return
    name = f"{identity.model} {identity.serial}"
    with _lock(name, f"the {role} ({table.driver}, {name})"):
        yield


@contextmanager
def _lock(name: str, device: str) -> Iterator[None]:
    """Lock a device by one of its names while the block runs."""
    full = f"{_PREFIX}-{hashlib.sha256(name.encode()).hexdigest()[:32]}"
    lock = take_named_lock(full)
    if lock is None:
        holder = find_lock_holder(full)
        who = name_process(holder) if holder else "another program of yours"
        raise UserError(f"{device} is in use by {who}. Close that first.")
    if not lock.is_held:
        log.warning(
            "%s: nothing but the device itself keeps your other programs from it, because there is "
            "no folder for locks. Make ~/.local/state a folder of yours that you may write",
            device,
        )
    with closing(lock):
        yield
