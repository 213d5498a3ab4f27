"""Locks, so that only one application of the user at a time uses a device.

Other users' applications aren't kept out by this, but by the lock of the device itself: that of the
serial port, the claim of the USB interface, or the control of the camera, which drivers take.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager

from drivers.device_holders import name_process
from drivers.interfaces import Identity
from labapp.bench.device_names import device_names
from labapp.common.errors import UserError
from labapp.common.named_locks import find_lock_holder, take_named_lock
from labapp.files.bench_file import DeviceTable

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
