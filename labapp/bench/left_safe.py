"""Which devices another process must make safe if this one is killed."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint

from drivers.hosted.guard import GuardedDevice
from labapp.files.bench_file import DeviceTable

_OF_THIS_PROCESS = ("sim://", "simulated-here@")
"""Beginnings of addresses of simulated wires that end with this process."""


def guarded_devices(
    tables: Mapping[str, DeviceTable], installed: Mapping[str, EntryPoint]
) -> list[GuardedDevice]:
    """Return the devices that would stay as they are if this process were killed.

    Others are left safe by a process of their own, or by the system. installed: drivers by name.
    """
    return [
        GuardedDevice(f"{role} ({table.driver})", installed[table.driver].value, table.options)
        for role, table in tables.items()
        if table.is_exclusive
        and table.driver in installed
        and not table.own_process
        and not any(_ends_with_this_process(value) for value in table.options.values())
        and not _is_left_safe(installed[table.driver])
    ]


def _ends_with_this_process(value: object) -> bool:
    """Return whether a device's option is something of this process: wire, function."""
    return callable(value) or (isinstance(value, str) and value.startswith(_OF_THIS_PROCESS))


def _is_left_safe(entry: EntryPoint) -> bool:
    """Return whether a driver leaves its device safe when its process is killed.

    One that doesn't load counts as such: it won't be opened.
    """
    try:
        return bool(getattr(entry.load(), "is_left_safe_when_killed", False))
    except Exception:
        return True
