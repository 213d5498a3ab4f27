"""The filter behind its wire: what it is told tunes the light of the virtual world."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from drivers.interfaces import Clock, Surroundings
from labapp.bench.virtual_bench.instruments import Instrument, on_a_wire
from labapp.bench.virtual_bench.shared import SharedWorld
from labapp.common.errors import UserError
from labapp.files.bench_file import DeviceTable
from simulator.devices import SimulatedFilter, SimulatedWheel
from simulator.machines.starlight_wheel import StarlightWheelMachine
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.machines.varispec import VariSpecMachine
from simulator.machines.zwo_wheel import ZwoWheelMachine
from simulator.wire.line import Line
from simulator.wire.pty import ServedLine
from simulator.wire.usb_backend import UsbBus
from simulator.wire.usb_remote import UsbServer, option

FILTERS = ("varispec", "thorlabs", "starlight", "zwo")

_SLOTS = ((450, 10), (500, 10), (532, 10), (550, 10), (600, 10), (633, 10))
"""Centres and widths in nm, of a wheel that no bench file tells."""

_OF_A_FILTER = ("range_nm", "bandwidth_nm", "settling_ms", "shape", "leak", "leak_range_nm")
_OF_A_WHEEL = ("slots_nm", "shape", "leak", "leak_range_nm")


def serve_filter(
    kind: str,
    described: DeviceTable,
    shared: SharedWorld,
    clock: Clock,
    folder: Path,
    stack: ExitStack,
) -> Instrument:
    """Start it until the stack is left.

    kind: one of FILTERS. described: the filter of the bench file, for its range, width, slots
    and shape where it tells them. UserError if it describes what this kind can't be.
    """
    try:
        if kind == "varispec":
            return _varispec(described, shared, clock, folder, stack)
        return _wheel(kind, described, shared, clock, folder, stack)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"the bench file's filter can't be a {kind}: {error}. Choose another --filter, or "
            "correct 'devices.filter.options'."
        ) from error


def _given(described: DeviceTable, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: described.options[name] for name in names if name in described.options}


def _varispec(
    described: DeviceTable, shared: SharedWorld, clock: Clock, folder: Path, stack: ExitStack
) -> Instrument:
    with shared.changing() as world:
        light = SimulatedFilter(Surroundings(clock, world), **_given(described, _OF_A_FILTER))
    low, high = light.wavelength_range

    def tuned(wavelength: float) -> None:
        with shared.changing() as world:
            world.wavelength = wavelength

    machine = VariSpecMachine(range_nm=(round(low * 1e9, 3), round(high * 1e9, 3)), tuned=tuned)
    line = Line(machine, baudrate=9600)
    port = folder / "varispec"
    stack.enter_context(ServedLine(line, port, clock))
    options = {
        "port": str(port),
        "bandwidth_nm": round(light.bandwidth * 1e9, 6),
        "settling_ms": round(light.settling * 1e3, 6),
    }
    return on_a_wire("varispec", options, line, machine.own_faults, clock)


def _wheel(
    kind: str,
    described: DeviceTable,
    shared: SharedWorld,
    clock: Clock,
    folder: Path,
    stack: ExitStack,
) -> Instrument:
    given = {"slots_nm": _SLOTS} | _given(described, _OF_A_WHEEL)
    with shared.changing() as world:
        light = stack.enter_context(SimulatedWheel(Surroundings(clock, world), **given))
    count = len(light.slots)

    def turned(slot: int) -> None:
        with shared.changing():
            light.set_slot(slot)

    options: dict[str, Any] = {"slots_nm": [list(slot) for slot in given["slots_nm"]]}
    if kind == "thorlabs":
        machine = ThorlabsWheelMachine(count, turned=turned)
        line, port = Line(machine, baudrate=115200), folder / "thorlabs-wheel"
        stack.enter_context(ServedLine(line, port, clock))
        options = {"port": str(port), **options}
        return on_a_wire("thorlabs-wheel", options, line, machine.own_faults, clock)
    make = StarlightWheelMachine if kind == "starlight" else ZwoWheelMachine
    usb = make(count, turned=turned)
    bus = UsbBus(clock)
    plug = bus.plug_in(usb)
    path = folder / "usb"
    stack.callback(path.unlink, missing_ok=True)
    stack.enter_context(UsbServer(bus, path))
    options |= {"backend": option(path)}
    return on_a_wire(f"{kind}-wheel", options, plug, usb.own_faults, clock)
