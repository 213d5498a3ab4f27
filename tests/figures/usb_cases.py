"""The drivers of USB wheels, each with its machine and the truth about every command."""

from __future__ import annotations

from functools import partial
from typing import Any

from drivers.starlight_wheel import StarlightWheel
from drivers.zwo_wheel import ZwoWheel
from figures.wheel_commands import WHEEL, slots_nm
from figures.wire_case import Command, WireCase, usb
from simulator.machines.usb_wheels import StarlightWheelMachine, ZwoWheelMachine

_SLOTS = 7
_AT = 4
"""Where a wheel stands at first: not where it is parked."""

_SERIAL = "W-17"
_STARTING = 30.0
"""Seconds in which a ZWO wheel must be open: it turns by itself when it gets power."""


def _knows_itself(device: Any, wheel: Any) -> bool:
    told = device.identity
    return (told.serial, told.simulated) == (_SERIAL, False) and wheel.position > 0


def _is_healthy(health: dict[str, str], wheel: Any) -> bool:
    description = wheel.machine.description
    said = (health["product"], health["maker"], health["serial number"])
    same = said == (description.name, description.maker, _SERIAL)
    state = health["slots"], health["slot"]
    if state in ((str(_SLOTS), "turning"), ("not counted yet", "turning")):
        return same and wheel.says_it_turns
    return same and state == (str(_SLOTS), str(wheel.position))


def _has_name(health: dict[str, str], wheel: Any) -> bool:
    named = (health["name"], health["firmware"], health["error"]) == ("EFW-S-0", "3.0.9", "0")
    return named and _is_healthy(health, wheel)


def _commands(healthy: Any, opening: float = 0.0) -> dict[str, Command]:
    return {
        "open": Command(lambda device, rng: device.__enter__(), _knows_itself, opening),
        **WHEEL,
        "health": Command(lambda device, rng: device.health(), healthy),
        "leave": Command(
            lambda device, rng: device.__exit__(None, None, None),
            lambda told, wheel: wheel.position == 1,
        ),
    }


def _starlight(name: str, counted: bool = True, **options: Any) -> WireCase:
    return WireCase(
        f"Starlight Xpress{name}",
        partial(StarlightWheelMachine, _SLOTS, _AT, step=0.2, slots_known=counted, serial=_SERIAL),
        usb,
        lambda surroundings, backend: StarlightWheel(
            surroundings, slots_nm(_SLOTS), step_ms=400.0, backend=backend, **options
        ),
        _commands(_is_healthy),
        delay=1.5,
        variant=bool(name),
    )


def _zwo(name: str, both_ways: bool = False, **options: Any) -> WireCase:
    # A controller that gives up wants its plug pulled: that no next command can work then is
    # the truth, but not what is tried here.
    return WireCase(
        f"ZWO EFW{name}",
        partial(
            ZwoWheelMachine, _SLOTS, _AT, step=0.2, both_ways=both_ways, max_steps=0, serial=_SERIAL
        ),
        usb,
        lambda surroundings, backend: ZwoWheel(
            surroundings,
            slots_nm(_SLOTS),
            step_ms=600.0,
            both_ways=both_ways,
            backend=backend,
            **options,
        ),
        _commands(_has_name, _STARTING),
        delay=1.5,
        variant=bool(name),
    )


USB_CASES = (
    _starlight(""),
    _starlight(" that has lost its count", counted=False, serial=_SERIAL),
    _zwo(""),
    _zwo(" that turns both ways", both_ways=True, serial=_SERIAL),
)
"""Another USB wheel joins by an entry here."""
