"""`labapp devices`: the devices of a bench, installed drivers and ports."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.ports import Port, cameras, screens, serial_ports, usb_devices
from labapp.common.console import out, print_json, print_table, terminal_progress

if TYPE_CHECKING:
    from labapp.bench.opening import BenchSetup


def list_devices(bench: Path | None, scene: Path | None, *, as_json: bool) -> None:
    """Print the devices with their ranges, the installed drivers, and the ports."""
    # Cameras on the network have a second to answer, in which the bench is loaded and opened.
    with ThreadPoolExecutor(1) as aside:
        search = aside.submit(_ports)
        from labapp.bench.driver_loading import installed_drivers
        from labapp.bench.opening import BenchFiles

        setup = BenchFiles.with_defaults(bench, scene).read()
        roles = list(setup.bench.devices.tables)
        described = []
        with terminal_progress() as progress:
            for number, role in enumerate(roles):
                progress.report(number / len(roles), role)
                described.append(describe_device(setup, role))
        installed = {entry.name: _load_error(entry) for entry in installed_drivers().values()}
        ports, trouble = search.result()
    if as_json:
        plugged = [vars(port) for port in ports]
        print_json(
            {
                "bench": setup.bench.name,
                "devices": described,
                "drivers": installed,
                "ports": plugged,
                "unlisted": trouble,
            }
        )
        return
    columns = ["device", "model", "", "can do"]
    rows = [list(one.values()) for one in described]
    print_table(f"Bench: {setup.bench.name}", columns, rows)
    rows = [[driver, bad or "installed"] for driver, bad in installed.items()]
    print_table("Drivers", ["name", "state"], rows)
    print_table(
        "Plugged in",
        ["kind", "address", "description"],
        [[port.kind, port.address, port.description] for port in ports],
    )
    for line in trouble:
        out.print(line)


def describe_device(setup: BenchSetup, role: str) -> dict[str, str]:
    """Describe a device: name, model, real or simulated, and its limits.

    The device is opened alone, so that a missing one doesn't prevent the others from being listed.
    For a missing device the limits say why it can't be opened.
    """
    from labapp.bench.opening import open_device
    from labapp.bench.selftest.checks import describe_error

    try:
        with open_device(setup, role) as alone:
            who = alone.device.identity
            kind, limits = "SIMULATED" if who.simulated else "real", _limits(role, alone.device)
            return {"device": role, "model": who.model, "kind": kind, "limits": limits}
    except Exception as error:
        driver, why = setup.bench.devices.tables[role].driver, describe_error(error, role)
        return {"device": role, "model": driver, "kind": "FAILED", "limits": why}


def _limits(role: str, device: Any) -> str:
    """Say in words what a device can do; KeyError for a role that has no such words."""
    match role:
        case "slm":
            rows, columns = device.shape
            return f"{columns} x {rows} pixels"
        case "filter":
            low, high = device.wavelength_range
            return f"{low * 1e9:.0f} to {high * 1e9:.0f} nm, {device.bandwidth * 1e9:g} nm wide"
        case "camera":
            (rows, columns), (shortest, longest) = device.shape, device.exposure_range
            return f"{columns} x {rows} pixels, {shortest * 1e3:g} to {longest * 1e3:g} ms"
        case "targets":
            return ", ".join(device.names)
        case "spectroradiometer":
            nm = device.wavelengths * 1e9
            return f"{nm[0]:.0f} to {nm[-1]:.0f} nm, {nm.size} values"
    raise KeyError(role)


def _load_error(entry: Any) -> str:
    """Return why a driver doesn't load, or an empty text if it does.

    Every exception is caught, so that a broken driver doesn't prevent the others from being listed.
    """
    try:
        entry.load()
    except Exception as error:
        return f"doesn't load: {error}"
    return ""


def _ports() -> tuple[list[Port], list[str]]:
    """Return the ports where devices may be, and messages on ports that can't be listed."""
    ports: list[Port] = []
    trouble = []
    for find in (serial_ports, usb_devices, cameras, screens):
        try:
            ports += find()
        except Exception as error:
            trouble.append(f"{find.__name__.replace('_', ' ')} can't be listed: {error}")
    return ports, trouble
