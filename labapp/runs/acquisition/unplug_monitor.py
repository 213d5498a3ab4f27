"""Whether the devices of a run are still there, looked at while the run waits for others."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from typing import Self

from drivers.supervised import SupervisedDevice

log = logging.getLogger(__name__)

_POLL_INTERVAL = 0.1
"""Seconds between looks. Nothing is said to a device: its port, its place on the bus or what
its own process has noticed is looked at."""

_JOIN_TIMEOUT = 0.5
"""Seconds for which a look that lasts is waited for in the end."""


class UnplugMonitor:
    """Names a device that was unplugged as soon as it is gone, whatever the run waits for.

    devices: devices by their names on the bench. Only named: what such a device is asked next
    fails, is tried again and opens it anew, as ever, and what goes on meanwhile, such as a long
    exposure, goes on. Each device is looked at by a thread of its own, so that one that hangs
    hides no other.
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
        """The devices that are gone now, and why; empty if all are there."""
        return "; ".join(f"{role}, {why}" for role, why in [*self._gone.items()])

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join(_JOIN_TIMEOUT)

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
