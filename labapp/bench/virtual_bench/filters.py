"""The filter behind its wire: what it is told tunes the light of the virtual world."""

from __future__ import annotations

from typing import Any

from drivers.interfaces import Surroundings
from labapp.bench.virtual_bench.instruments import Instrument, Site, on_a_line, on_a_wire
from labapp.common.errors import UserError
from labapp.files.bench_file import DeviceTable
from simulator.devices import SimulatedFilter, SimulatedWheel
from simulator.machines.starlight_wheel import StarlightWheelMachine
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.machines.varispec import VariSpecMachine
from simulator.machines.zwo_wheel import ZwoWheelMachine
from simulator.wire.usb_backend import UsbBus
from simulator.wire.usb_remote import UsbServer, option

FILTERS = ("varispec", "thorlabs", "starlight", "zwo")

_SLOTS = ((450, 10), (500, 10), (532, 10), (550, 10), (600, 10), (633, 10))
"""Centres and widths in nm, of a wheel that no bench file tells."""

_OF_A_FILTER = ("range_nm", "bandwidth_nm", "settling_ms", "shape", "leak", "leak_range_nm")
_OF_A_WHEEL = ("slots_nm", "shape", "leak", "leak_range_nm")


def serve_filter(kind: str, described: DeviceTable, site: Site) -> Instrument:
    """Start it until the site's stack is left.

    kind: one of FILTERS. described: the filter of the bench file, for its range, width, slots
    and shape where it tells them. UserError if it describes what this kind can't be.
    """
    try:
        if kind == "varispec":
            return _varispec(described, site)
        return _wheel(kind, described, site)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"the bench file's filter can't be a {kind}: {error}. Choose another --filter, or "
            "correct 'devices.filter.options'."
        ) from error


def _given(described: DeviceTable, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: described.options[name] for name in names if name in described.options}


def _varispec(described: DeviceTable, site: Site) -> Instrument:
    with site.shared.changing() as world:
        light = SimulatedFilter(Surroundings(site.clock, world), **_given(described, _OF_A_FILTER))
    low, high = light.wavelength_range

    def tuned(wavelength: float) -> None:
        with site.shared.changing() as world:
            world.wavelength = wavelength

    machine = VariSpecMachine(range_nm=(round(low * 1e9, 3), round(high * 1e9, 3)), tuned=tuned)
    return on_a_line(
        site,
        "varispec",
        machine,
        9600,
        bandwidth_nm=round(light.bandwidth * 1e9, 6),
        settling_ms=round(light.settling * 1e3, 6),
    )


def _wheel(kind: str, described: DeviceTable, site: Site) -> Instrument:
    given = {"slots_nm": _SLOTS} | _given(described, _OF_A_WHEEL)
    with site.shared.changing() as world:
        light = site.stack.enter_context(SimulatedWheel(Surroundings(site.clock, world), **given))
    count = len(light.slots)

    def turned(slot: int) -> None:
        with site.shared.changing():
            light.set_slot(slot)

    options: dict[str, Any] = {"slots_nm": [list(slot) for slot in given["slots_nm"]]}
    if kind == "thorlabs":
        machine = ThorlabsWheelMachine(count, turned=turned)
        return on_a_line(site, "thorlabs-wheel", machine, 115200, **options)
    make = StarlightWheelMachine if kind == "starlight" else ZwoWheelMachine
    usb = make(count, turned=turned)
    bus, path = UsbBus(site.clock), site.folder / "usb"
    plug = bus.plug_in(usb)
    site.stack.callback(path.unlink, missing_ok=True)
    site.stack.enter_context(UsbServer(bus, path))
    options |= {"backend": option(path)}
    return on_a_wire(f"{kind}-wheel", options, plug, usb.own_faults, site.clock)
