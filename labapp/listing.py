"""`labapp devices`: what there is to work with."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.markup import escape

from drivers.errors import DeviceError
from drivers.ports import Port, cameras, screens, serial_ports, usb_devices
from labapp.bench import Bench, BenchFiles, drivers, open_bench
from labapp.console import out, print_json, table
from labapp.errors import UserError
from labapp.selftest.checks import broke


def list_devices(bench: Path | None, scene: Path | None, *, as_json: bool) -> bool:
    """Print the bench's devices with their ranges, the drivers, and the ports.

    Whether the bench could be opened: where it can't, the ports are what is looked for.
    UserError for a file that can't be read.
    """
    setup = BenchFiles.default(bench, scene).read()
    name, failure = setup.bench.name, ""
    described: list[dict[str, str]] = []
    try:
        with open_bench(setup) as opened:
            described = describe_bench(opened)
    except (UserError, DeviceError) as error:
        failure = str(error)
    except Exception as error:
        failure = broke(error)
    installed = {entry.name: _loads(entry) for entry in drivers().values()}
    ports, trouble = _ports()
    if as_json:
        plugged = [vars(port) for port in ports]
        print_json(
            {"bench": name, "trouble": failure, "devices": described, "drivers": installed}
            | {"ports": plugged, "unlisted": trouble}
        )
        return not failure
    if failure:
        out.print(f"Bench: {name}", style="bold", markup=False)
        out.print(f"{failure}\n", style="bold red", markup=False)
    else:
        columns = ["device", "model", "", "can do"]
        table(f"Bench: {name}", columns, [_plain(row.values()) for row in described])
    rows = [[driver, escape(bad or "installed")] for driver, bad in installed.items()]
    table("Drivers", ["name", "state"], rows)
    table(
        "Plugged in",
        ["kind", "address", "description"],
        [_plain([port.kind, port.address, port.description]) for port in ports],
    )
    for line in trouble:
        out.print(line, markup=False)
    return not failure


def _plain(cells: Iterable[str]) -> list[str]:
    """As they are: what a device calls itself is no markup."""
    return [escape(cell) for cell in cells]


def describe_bench(bench: Bench) -> list[dict[str, str]]:
    """Every device of a bench: name, model, real or simulated, and its limits."""
    low, high = bench.filter.wavelength_range
    shortest, longest = bench.camera.exposure_range
    width = bench.filter.bandwidth * 1e9
    (slm_rows, slm_columns), (rows, columns) = bench.slm.shape, bench.camera.shape
    limits = {
        "slm": f"{slm_columns} x {slm_rows} pixels",
        "filter": f"{low * 1e9:.0f} to {high * 1e9:.0f} nm, {width:g} nm wide",
        "camera": f"{columns} x {rows} pixels, {shortest * 1e3:g} to {longest * 1e3:g} ms",
        "targets": ", ".join(bench.targets.names),
    }
    return [
        {
            "device": name,
            "model": device.identity.model,
            "kind": "SIMULATED" if device.identity.simulated else "real",
            "limits": limits[name],
        }
        for name, device in bench.devices.items()
    ]


def _loads(entry: Any) -> str:
    """Empty if a driver loads, else why it doesn't; a broken one harms nobody else."""
    try:
        entry.load()
    except Exception as error:
        return f"doesn't load: {error}"
    return ""


def _ports() -> tuple[list[Port], list[str]]:
    """The ports that can be listed, and why others can't."""
    ports: list[Port] = []
    trouble = []
    for find in (serial_ports, usb_devices, cameras, screens):
        try:
            ports += find()
        except Exception as error:
            trouble.append(f"{find.__name__.replace('_', ' ')} can't be listed: {error}")
    return ports, trouble
