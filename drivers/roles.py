"""Tell a device that was put into another's role on a bench by what it can't do."""

from __future__ import annotations

from typing import Any

_TASKS = {
    "slm": "show",
    "filter": "set_wavelength",
    "camera": "capture",
    "targets": "place",
    "spectroradiometer": "measure",
}
"""The method by which a bench uses the device of a role; none of the others has it."""


def misfit(device: Any, role: str) -> str:
    """Say why a device, or its class, can't have a role such as "camera"; empty if it may.

    Whatever has none of the roles' methods may get them when it's entered.
    """
    able = [other for other, method in _TASKS.items() if callable(getattr(device, method, None))]
    if role not in _TASKS or role in able or not able:
        return ""
    return f"is a driver for the role {' or '.join(able)}, not for {role}"
