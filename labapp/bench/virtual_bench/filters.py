"""A simulated filter, served at a port; its commands tune the light of the world."""

from __future__ import annotations

from typing import Any

from drivers.interfaces import Surroundings
from labapp.bench.virtual_bench.instruments import (
    ServedInstrument,
    ServingContext,
    serve_on_serial_line,
    wired_instrument,
)
from labapp.common.errors import UserError
from labapp.files.bench_file import DeviceTable
from simulator.devices import SimulatedFilter, SimulatedWheel
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.machines.usb_wheels import StarlightWheelMachine, ZwoWheelMachine
from simulator.machines.varispec import VariSpecMachine
from simulator.wire.usb_backend import UsbBus
from simulator.wire.usb_remote import UsbServer, backend_option

FILTERS = ("varispec", "thorlabs", "starlight", "zwo")

_SLOTS = ((450, 10), (500, 10), (532, 10), (550, 10), (600, 10), (633, 10))
"""Centres and widths in nm of the slots of a wheel that the bench file doesn't describe."""

_BAND_OPTIONS = ("shape", "leak", "leak_range_nm", "effective_index")
_FILTER_OPTIONS = ("range_nm", "bandwidth_nm", "settling_ms", *_BAND_OPTIONS)
_WHEEL_OPTIONS = ("slots_nm", *_BAND_OPTIONS)


def serve_filter(kind: str, table: DeviceTable, site: ServingContext) -> ServedInstrument:
    """Serve a simulated filter until the site's stack is left.

    `kind` is one of `FILTERS`. `table` is the filter of the bench file, which may give range,
    width, slots and shape. Raises UserError if the table doesn't fit this kind of filter.
    """
    try:
        if kind == "varispec":
            return _serve_varispec(table, site)
        return _serve_wheel(kind, table, site)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"the bench file's filter can't be a {kind}: {error}. Choose another --filter, or "
            "correct 'devices.filter.options'."
        ) from error


def _select_options(described: DeviceTable, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: described.options[name] for name in names if name in described.options}


def _serve_varispec(described: DeviceTable, site: ServingContext) -> ServedInstrument:
    with site.shared.exclusive_access() as world:
        light = SimulatedFilter(
            Surroundings(site.clock, world), **_select_options(described, _FILTER_OPTIONS)
        )
    low, high = light.wavelength_range

    def apply_wavelength(wavelength: float) -> None:
        with site.shared.exclusive_access() as world:
            world.wavelength = wavelength

    machine = VariSpecMachine(
        range_nm=(round(low * 1e9, 3), round(high * 1e9, 3)), on_tuned=apply_wavelength
    )
    return serve_on_serial_line(
        site,
        "varispec",
        machine,
        9600,
        bandwidth_nm=round(light.bandwidth * 1e9, 6),
        settling_ms=round(light.settling * 1e3, 6),
    )


def _serve_wheel(kind: str, described: DeviceTable, site: ServingContext) -> ServedInstrument:
    given = {"slots_nm": _SLOTS} | _select_options(described, _WHEEL_OPTIONS)
    with site.shared.exclusive_access() as world:
        light = site.stack.enter_context(SimulatedWheel(Surroundings(site.clock, world), **given))
    count = len(light.slots)

    def apply_slot(slot: int) -> None:
        with site.shared.exclusive_access():
            light.set_slot(slot)

    options: dict[str, Any] = {"slots_nm": [list(slot) for slot in given["slots_nm"]]}
    if kind == "thorlabs":
        machine = ThorlabsWheelMachine(count, on_slot=apply_slot)
        return serve_on_serial_line(site, "thorlabs-wheel", machine, 115200, **options)
    make = StarlightWheelMachine if kind == "starlight" else ZwoWheelMachine
    usb = make(count, on_slot=apply_slot)
    bus, path = UsbBus(site.clock), site.folder / "usb"
    plug = bus.plug_in(usb)
    site.stack.callback(path.unlink, missing_ok=True)
    site.stack.enter_context(UsbServer(bus, path))
    options |= {"backend": backend_option(path)}
    return wired_instrument(f"{kind}-wheel", options, plug, usb.own_faults, site.clock)
