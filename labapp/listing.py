"""`labapp devices`: what there is to work with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.ports import Port, cameras, screens, serial_ports, usb_devices
from labapp.bench import Bench, BenchFiles, drivers, open_bench
from labapp.console import out, print_json, table


def list_devices(bench: Path | None, scene: Path | None, *, as_json: bool) -> None:
    """Print the bench's devices with their ranges, the drivers, and the ports."""
    with open_bench(BenchFiles.default(bench, scene)) as opened:
        described = describe_bench(opened)
        name = opened.file.name
    installed = {entry.name: _loads(entry) for entry in drivers().values()}
    ports, trouble = _ports()
    if as_json:
        plugged = [vars(port) for port in ports]
        print_json({"bench": name, "devices": described, "drivers": installed, "ports": plugged})
        return
    columns = ["device", "model", "", "can do"]
    table(f"Bench: {name}", columns, [list(row.values()) for row in described])
    rows = [[driver, bad or "installed"] for driver, bad in installed.items()]
    table("Drivers", ["name", "state"], rows)
    table(
        "Plugged in",
        ["kind", "address", "description"],
        [[port.kind, port.address, port.description] for port in ports],
    )
    for line in trouble:
        out.print(line, markup=False)


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
