"""The serial drivers, each with its machine and the truth about every command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.interfaces import Surroundings
from drivers.varispec import VariSpec
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
)
"""Another serial driver joins by an entry here."""
