"""The serial drivers, each with its machine and the truth about every command."""

from __future__ import annotations

from typing import Any

import numpy as np

from drivers.cs2000 import CS2000
from drivers.thorlabs_wheel import ThorlabsWheel
from drivers.varispec import VariSpec
from figures.wheel_commands import WHEEL, slots_nm
from figures.wire_case import Command, Rng, WireCase, serial
from simulator.machines.colorimetry import tristimulus
from simulator.machines.cs2000 import CS2000Machine
from simulator.machines.cs2000_settings import WAVELENGTHS
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.machines.varispec import VariSpecMachine


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
    near = abs(setting.request - setting.actual) < 0.6e-11
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
    "open": Command(lambda device, rng: device.__enter__(), _knows_itself, 60.0),
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


THORLABS = {
    "open": Command(lambda device, rng: device.__enter__(), _is_set, 60.0),
    **WHEEL,
    "health": Command(lambda d, rng: d.health(), _wheel_is_healthy),
    "save": Command(lambda d, rng: d.save(), lambda told, m: m.saved_settings == m.settings),
}


def _wheel(slots: int, firmware: str, avoid: tuple[int, ...]) -> WireCase:
    return WireCase(
        f"Thorlabs FW{'102' if slots == 6 else '212'}C, firmware {firmware}",
        lambda: ThorlabsWheelMachine(slots, firmware),
        serial(115200),
        lambda surroundings, url: ThorlabsWheel(surroundings, url, slots_nm(slots), avoid=avoid),
        THORLABS,
        variant=not avoid,
    )


def _light(wavelengths: Any) -> Any:
    """Bright enough to be measured in three seconds, and no two nanometres alike."""
    nm = wavelengths * 1e9
    return 2e5 * (1 + 0.5 * np.sin(nm / 23) + nm / 1000)


def _is_the_light(told: Any, machine: Any) -> bool:
    if machine.measured_radiance is None or machine.is_measuring:
        return False
    conditions = machine.conditions.split(",")
    same = np.allclose(told.radiance, machine.measured_radiance * 1e9, rtol=1e-6, atol=0)
    times = round(told.integration_time * 1e6) == int(conditions[2])
    return bool(same and times and told.nd_filter_used == (conditions[3] == "1"))


def _are_the_colours(told: Any, machine: Any) -> bool:
    return bool(
        np.allclose(told, tristimulus(WAVELENGTHS, machine.measured_radiance * 1e9), rtol=1e-6)
    )


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
    WireCase(
        "VariSpec",
        VariSpecMachine,
        serial(9600),
        lambda surroundings, url: VariSpec(surroundings, port=url),
        VARISPEC,
    ),
    WireCase(
        "VariSpec with RS-232",
        lambda: VariSpecMachine(electronics="rs232"),
        serial(9600),
        lambda surroundings, url: VariSpec(surroundings, port=url),
        VARISPEC,
        variant=True,
    ),
    _wheel(6, "1.07", (2,)),
    _wheel(12, "1.04", ()),
    _wheel(6, "1.0", ()),
    WireCase(
        "CS-2000A",
        lambda: CS2000Machine(_light),
        serial(115200),
        lambda surroundings, url: CS2000(surroundings, url),
        CS,
        delay=12.0,
    ),
)
"""Another serial driver joins by an entry here."""
