"""The serial drivers, each with its machine and the truth about every command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.cs2000 import CS2000
from drivers.interfaces import Surroundings
from drivers.thorlabs_wheel import ThorlabsWheel
from drivers.varispec import VariSpec
from simulator.machines.colorimetry import tristimulus
from simulator.machines.cs2000 import CS2000Machine
from simulator.machines.cs2000_optics import WAVELENGTHS
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.machines.varispec import VariSpecMachine

Rng = np.random.Generator


@dataclass(frozen=True)
class Command:
    """Something that a device is asked.

    run: asks it, and gives back its answer. right: whether that answer is the truth about the
    machine. seconds: that are documented for it, where they are more than the reply time.
    """

    run: Callable[[Any, Rng], Any]
    right: Callable[[Any, Any], bool]
    seconds: float = 0.0


@dataclass(frozen=True)
class SerialCase:
    """A driver and its machine.

    machine: a fresh one, ready for use. device: the driver on a port, not yet open. opening:
    seconds in which it must be open. delay: seconds by which late answers are late, more than
    the driver waits for them. variant: of another case with the same driver.
    """

    name: str
    machine: Callable[[], Any]
    baudrate: int
    device: Callable[[Surroundings, str], Any]
    commands: dict[str, Command]
    opening: float = 60.0
    delay: float = 3.0
    variant: bool = False


def _tune(device: Any, rng: Rng) -> Any:
    return device.set_wavelength(float(rng.integers(40000, 72001)) * 1e-11)


def _define(device: Any, rng: Rng) -> Any:
    count = int(rng.integers(1, 4))
    return device.define_palette([n * 1e-11 for n in rng.integers(40000, 72001, count)])


def _choose(device: Any, rng: Rng) -> Any:
    device.define_palette([450e-9, 550e-9])
    return device.choose(int(rng.integers(2)))


def _metres(nm: float) -> float:
    return round(nm * 100) / 1e11


def _is_tuned(setting: Any, machine: Any) -> bool:
    near = abs(setting.asked - setting.actual) < 0.6e-11
    return near and setting.actual == _metres(machine.state.wavelength)


def _knows_itself(device: Any, machine: Any) -> bool:
    state = machine.state
    told = (int(device.identity.serial), *device.wavelength_range)
    ready: bool = state.initialised and state.brief == 0 and state.sync == 0
    return ready and told == (machine.serial, _metres(state.shortest), _metres(state.longest))


def _is_healthy(health: Any, machine: Any) -> bool:
    number, heat = int(health["serial number"]), float(health["temperature"].split()[0])
    return number == machine.serial and 20 < heat < 26 and "exercised" in health["status"]


def _holds(palette: Any, machine: Any) -> bool:
    return palette == tuple(map(_metres, machine.state.palette))


VARISPEC = {
    "open": Command(lambda device, rng: device.__enter__(), _knows_itself),
    "set_wavelength": Command(_tune, _is_tuned),
    "wavelength": Command(
        lambda d, rng: d.wavelength, lambda told, m: told == _metres(m.state.wavelength)
    ),
    "temperature": Command(lambda d, rng: d.temperature, lambda told, m: 20 < told < 26),
    "health": Command(lambda d, rng: d.health(), _is_healthy),
    "define_palette": Command(_define, _holds, 20.0),
    "palette": Command(lambda d, rng: d.palette, _holds, 8.0),
    "clear_palette": Command(
        lambda d, rng: d.clear_palette(), lambda told, m: m.state.palette == []
    ),
    "choose": Command(_choose, _is_tuned, 20.0),
    "refresh": Command(lambda d, rng: d.refresh(), lambda told, m: m.state.initialised, 65.0),
    "exercise": Command(lambda d, rng: d.exercise(1), lambda told, m: m.state.exercised, 40.0),
    "sleep": Command(lambda d, rng: d.sleep(), lambda told, m: m.state.asleep),
    "awaken": Command(lambda d, rng: d.awaken(), lambda told, m: not m.state.asleep),
    "make_safe": Command(
        lambda d, rng: d.make_safe(), lambda told, m: m.state.wavelength == m.state.shortest
    ),
}  # fmt: skip


def _turn(device: Any, rng: Rng) -> Any:
    return device.set_slot(int(rng.integers(1, len(device.slots) + 1)))


def _turn_by_wavelength(device: Any, rng: Rng) -> Any:
    return device.set_wavelength(device.slots[int(rng.integers(len(device.slots)))].wavelength)


def _stands(setting: Any, machine: Any) -> bool:
    return setting.asked == setting.actual == machine.position


def _centre(slot: int) -> float:
    """Of the cases' wheels."""
    return (400 + 20 * slot) / 1e9


def _is_near(wavelength: float, machine: Any) -> bool:
    return abs(wavelength - _centre(machine.position)) < 1e-12


def _is_set(device: Any, machine: Any) -> bool:
    wanted = {"speed": 1, "sensors": 0, "trig": 0, "pcount": len(device.slots)}
    told: bool = device.identity.model[-5:-1] == f"W{'102' if wanted['pcount'] == 6 else '212'}"
    known = wanted if machine.firmware != "1.0" else {"trig": 0}
    return told and all(machine.settings[name] == value for name, value in known.items())


def _wheel_is_healthy(health: dict[str, str], machine: Any) -> bool:
    told = {"slot": machine.position, **machine.settings}
    settings = {name: int(value) for name, value in health.items() if name != "firmware"}
    same = all(told[name] == value for name, value in settings.items())
    return same and health["firmware"] == machine.firmware and len(settings) >= 2


WHEEL = {
    "open": Command(lambda device, rng: device.__enter__(), _is_set, 60.0),
    "set_slot": Command(_turn, _stands),
    "set_wavelength": Command(
        _turn_by_wavelength, lambda told, m: told.asked == told.actual and _is_near(told.actual, m)
    ),
    "slot": Command(lambda d, rng: d.slot, lambda told, m: told == m.position),
    "wavelength": Command(lambda d, rng: d.wavelength, _is_near),
    "health": Command(lambda d, rng: d.health(), _wheel_is_healthy),
    "save": Command(lambda d, rng: d.save(), lambda told, m: m.saved == m.settings),
    "make_safe": Command(lambda d, rng: d.make_safe(), lambda told, m: m.position == 1),
}


def _wheel(slots: int, firmware: str, avoid: tuple[int, ...]) -> SerialCase:
    slots_nm = [[_centre(slot) * 1e9, 10] for slot in range(1, slots + 1)]
    return SerialCase(
        f"Thorlabs FW{'102' if slots == 6 else '212'}C, firmware {firmware}",
        lambda: ThorlabsWheelMachine(slots, firmware),
        115200,
        lambda surroundings, url: ThorlabsWheel(surroundings, url, slots_nm, avoid=avoid),
        WHEEL,
        variant=not avoid,
    )


def _light(wavelengths: Any) -> Any:
    """Bright enough to be measured in three seconds, and no two nanometres alike."""
    nm = wavelengths * 1e9
    return 2e5 * (1 + 0.5 * np.sin(nm / 23) + nm / 1000)


def _is_the_light(told: Any, machine: Any) -> bool:
    if machine.measured is None or machine.is_measuring:
        return False
    conditions = machine.conditions.split(",")
    same = np.allclose(told.radiance, machine.measured * 1e9, rtol=1e-6, atol=0)
    times = round(told.integration * 1e6) == int(conditions[2])
    return bool(same and times and told.dimmed == (conditions[3] == "1"))


def _are_the_colours(told: Any, machine: Any) -> bool:
    return bool(np.allclose(told, tristimulus(WAVELENGTHS, machine.measured * 1e9), rtol=1e-6))


def _colours(device: Any, rng: Rng) -> Any:
    device.measure(lambda: False)
    return device.tristimulus()


CS = {
    "open": Command(
        lambda device, rng: device.__enter__(),
        lambda d, m: (d.identity.serial, d.identity.model[15:]) == ("1000123", "CS-2000A"),
        60.0,
    ),
    "measure": Command(lambda d, rng: d.measure(lambda: False), _is_the_light, 50.0),
    "tristimulus": Command(_colours, _are_the_colours, 82.0),
    "health": Command(
        lambda d, rng: d.health(),
        lambda told, m: list(told.values()) == ["1000123", "1°", "2024-02-01"],
    ),
    "make_safe": Command(lambda d, rng: d.make_safe(), lambda told, m: not m.is_measuring),
}

SERIAL_CASES = (
    SerialCase(
        "VariSpec",
        VariSpecMachine,
        9600,
        lambda surroundings, url: VariSpec(surroundings, port=url),
        VARISPEC,
    ),
    SerialCase(
        "VariSpec with RS-232",
        lambda: VariSpecMachine(electronics="rs232"),
        9600,
        lambda surroundings, url: VariSpec(surroundings, port=url),
        VARISPEC,
        variant=True,
    ),
    _wheel(6, "1.07", (2,)),
    _wheel(12, "1.04", ()),
    _wheel(6, "1.0", ()),
    SerialCase(
        "CS-2000A",
        lambda: CS2000Machine(_light),
        115200,
        lambda surroundings, url: CS2000(surroundings, url),
        CS,
        delay=12.0,
    ),
)
"""Another serial driver joins by an entry here."""
