"""`labapp bench check`: whether a bench file is right, and what it names is there."""

from __future__ import annotations

from pathlib import Path

from rich.markup import escape

from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from labapp.bench.opening import BenchFiles, BenchSetup, OpenDevice, device_maker, open_device
from labapp.bench.selftest.checks import describe_error, identity_text
from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.common.errors import UserError

Row = tuple[str, bool, str]
"""What was looked at, whether it is well, and what was seen."""


def check_bench(bench: Path, scene: Path | None, *, open_devices: bool, as_json: bool) -> bool:
    """Check a bench file and its devices, one by one, and print it; whether all is well.

    open_devices: whether the devices are opened, too. UserError for a file that can't be read.
    """
    setup = BenchFiles.with_defaults(bench, scene).read()
    camera = setup.bench.build_camera()
    rows: list[Row] = [("file", True, f"{setup.bench.name}: {camera.panel.shape[1]} x "
                        f"{camera.panel.shape[0]} panel, {camera.sensor.shape[1]} x "
                        f"{camera.sensor.shape[0]} sensor")]  # fmt: skip
    roles = list(setup.bench.devices.tables)
    with terminal_progress() as progress:
        for number, role in enumerate(roles):
            progress.report(number / len(roles), f"{role}")
            rows.append(_check_device(setup, role, open_devices))
    well = all(good for _, good, _ in rows)
    if as_json:
        checks = [dict(zip(("check", "well", "seen"), row, strict=True)) for row in rows]
        print_json({"bench": str(bench), "well": well, "checks": checks})
        return well
    shown = [[what, "ok" if good else "WRONG", escape(seen)] for what, good, seen in rows]
    print_table(str(bench), ["", "", "seen"], shown)
    if not open_devices:
        out.print("The devices weren't opened.", markup=False)
    return well


def _check_device(setup: BenchSetup, role: str, open_devices: bool) -> Row:
    try:
        return role, True, _describe_device(setup, role, open_devices)
    except Exception as error:
        return role, False, describe_error(error, role)


def _describe_device(setup: BenchSetup, role: str, open_devices: bool) -> str:
    """What a device is, or would be; UserError or DeviceError for what is wrong."""
    described = setup.bench.devices.tables[role]
    if not open_devices:
        device_maker(role, described, Surroundings(RealClock()), setup.source)
        return f"{described.driver} is installed and takes these options"
    with open_device(setup, role) as alone:
        _require_matching_shape(setup, role, alone)
        return identity_text(alone.device)


def _require_matching_shape(setup: BenchSetup, role: str, opened: OpenDevice) -> None:
    """UserError if a device has other pixels than the bench file says."""
    camera = setup.bench.build_camera()
    described = {"slm": ("panel", camera.panel.shape), "camera": ("sensor", camera.sensor.shape)}
    if role not in described:
        return
    part, shape = described[role]
    there = tuple(opened.device.shape)
    if there != tuple(shape):
        raise UserError(
            f"{setup.source}: [{part}] has {shape[1]} x {shape[0]} pixels, and the {role} has "
            f"{there[1]} x {there[0]}. Correct the file, or the device's options."
        )
