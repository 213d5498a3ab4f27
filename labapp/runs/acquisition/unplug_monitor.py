"""Monitor during a run whether devices were unplugged, also while it waits for others."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from drivers.supervised import SupervisedDevice

log = logging.getLogger(__name__)

_POLL_INTERVAL = 0.1
"""Seconds between checks of a device. A check sends nothing to the device: it looks at the
device's port, its place on the bus, or what the device's own process has noticed."""


class UnplugMonitor:
    """Reports a device that was unplugged at once, whatever else is waited for.

    The monitor only reports: an exposure in progress goes on, and the next call of the unplugged
    device fails and is retried as usual. Each device is checked in a thread of its own, so that a
    check that hangs doesn't delay the others.

    devices: the supervised devices by role.
    """

    def __init__(self, devices: Mapping[str, SupervisedDevice]) -> None:
        self._over = threading.Event()
        self._gone: dict[str, str] = {}
        self._threads = [
            threading.Thread(
                target=self._look_at, args=(role, device), name=f"lookout {role}", daemon=True
            )
            for role, device in devices.items()
            if device.can_report_unplugging
        ]

    @property
    def message(self) -> str:
        """The devices that are unplugged at this moment, and why; empty if none is."""
        return "; ".join(f"{role}, {why}" for role, why in [*self._gone.items()])

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        for thread in self._threads:
            # A check that hangs is left to itself: the thread is a daemon.
            thread.join(0.5)

    def _look_at(self, role: str, device: SupervisedDevice) -> None:
        while not self._over.wait(_POLL_INTERVAL):
            why = device.unplugged_reason()
            if why is None or self._over.is_set():
                continue
            was_gone = role in self._gone
            if why:
                self._gone[role] = why
                if not was_gone:
                    log.warning("%s unplugged: %s. Plug it in again, the run goes on", role, why)
            elif was_gone:
                del self._gone[role]
                log.info("%s is there again", role)
