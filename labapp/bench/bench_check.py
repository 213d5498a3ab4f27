"""`labapp bench check`: a bench file, and whether the devices that it names are there."""

from __future__ import annotations

from pathlib import Path

from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from labapp.bench.camera_match import require_described_camera, require_described_size
from labapp.bench.driver_loading import device_maker
from labapp.bench.opening import BenchFiles, BenchSetup, open_device
from labapp.bench.selftest.checks import describe_error, identity_text
from labapp.common.console import out, print_json, print_table, terminal_progress

Row = tuple[str, bool, str]
"""One line of the check: what was checked, whether it is good, and what was found."""


def check_bench(bench: Path, scene: Path | None, *, open_devices: bool, as_json: bool) -> bool:
    """Check a bench file and its devices, print the results, and return whether all is well.

    Raises UserError for a file that can't be read.

    scene: for simulated devices; None for the bundled one.
    open_devices: whether each device is opened, too.
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
            try:
                rows.append((role, True, _describe_device(setup, role, open_devices)))
            except Exception as error:
                rows.append((role, False, describe_error(error, role)))
    well = all(good for _, good, _ in rows)
    if as_json:
        checks = [dict(zip(("check", "well", "seen"), row, strict=True)) for row in rows]
        print_json({"bench": str(bench), "well": well, "checks": checks})
        return well
    shown = [[what, "ok" if good else "WRONG", seen] for what, good, seen in rows]
    print_table(str(bench), ["", "", "seen"], shown)
    if not open_devices:
        out.print("The devices weren't opened.")
    return well


def _describe_device(setup: BenchSetup, role: str, open_devices: bool) -> str:
    """Say which device is there, or that its driver accepts the options.

    Raises UserError or DeviceError for what is wrong, also if it isn't as the file describes it.
    """
    described = setup.bench.devices.tables[role]
    if not open_devices:
        device_maker(role, described, Surroundings(RealClock()), setup.source)
        return f"{described.driver} is installed and takes these options"
    with open_device(setup, role) as alone:
        camera, device = setup.bench.build_camera(), alone.device
        if role == "slm":
            require_described_size(role, device.shape, camera.panel.shape, "panel", setup.source)
        elif role == "camera":
            require_described_camera(device, camera.sensor, setup.source)
        return identity_text(device)
