"""`labapp bench check`: whether a bench file is right, and what it names is there."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rich.markup import escape

from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from labapp.bench.opening import Alone, BenchFiles, BenchSetup, maker, open_device
from labapp.bench.selftest.checks import broke
from labapp.common.console import out, print_json, table, watched
from labapp.common.errors import UserError

log = logging.getLogger(__name__)

Row = tuple[str, bool, str]
"""What was looked at, whether it is well, and what was seen."""


def check_bench(bench: Path, scene: Path | None, *, opening: bool, as_json: bool) -> bool:
    """Check a bench file and its devices, one by one, and print it; whether all is well.

    opening: whether the devices are opened, too. UserError for a file that can't be read.
    """
    setup = BenchFiles.default(bench, scene).read()
    camera = setup.bench.build_camera()
    rows: list[Row] = [("file", True, f"{setup.bench.name}: {camera.panel.shape[1]} x "
                        f"{camera.panel.shape[0]} panel, {camera.sensor.shape[1]} x "
                        f"{camera.sensor.shape[0]} sensor")]  # fmt: skip
    roles = list(setup.bench.devices.tables)
    with watched() as progress:
        for number, role in enumerate(roles):
            progress.report(number / len(roles), f"{role}")
            rows.append(_told(role, partial(_device, setup, role, opening)))
    well = all(good for _, good, _ in rows)
    if as_json:
        print_json({"bench": str(bench), "well": well, "checks": [_as_data(row) for row in rows]})
        return well
    shown = [[what, "ok" if good else "WRONG", escape(seen)] for what, good, seen in rows]
    table(str(bench), ["", "", "seen"], shown)
    if not opening:
        out.print("The devices weren't opened.", markup=False)
    return well


def _as_data(row: Row) -> dict[str, Any]:
    return dict(zip(("check", "well", "seen"), row, strict=True))


def _told(role: str, see: Callable[[], str]) -> Row:
    try:
        return role, True, see()
    except (UserError, DeviceError) as error:
        return role, False, str(error)
    except Exception as error:
        # A broken driver of somebody else's hides no other device.
        log.info("%s", role, exc_info=error)
        return role, False, broke(error)


def _device(setup: BenchSetup, role: str, opening: bool) -> str:
    """What a device is, or would be; UserError or DeviceError for what is wrong."""
    described = setup.bench.devices.tables[role]
    if not opening:
        maker(role, described, Surroundings(clock=_NoClock()), setup.source)
        return f"{described.driver} is installed and takes these options"
    with open_device(setup, role) as alone:
        who = alone.device.identity
        _require_fitting(setup, role, alone)
    simulated = ", SIMULATED" if who.simulated else ""
    return f"{who.model}, serial number {who.serial or 'unknown'}{simulated}"


def _require_fitting(setup: BenchSetup, role: str, alone: Alone) -> None:
    """UserError if a device has other pixels than the bench file says."""
    camera = setup.bench.build_camera()
    described = {"slm": ("panel", camera.panel.shape), "camera": ("sensor", camera.sensor.shape)}
    if role not in described:
        return
    part, shape = described[role]
    there = tuple(alone.device.shape)
    if there != tuple(shape):
        raise UserError(
            f"{setup.source}: [{part}] has {shape[1]} x {shape[0]} pixels, and the {role} has "
            f"{there[1]} x {there[0]}. Correct the file, or the device's options."
        )


class _NoClock:
    """Of devices that are never opened."""

    def now(self) -> float:
        return 0.0

    def wait_until(self, time: float, cancelled: Callable[[], bool]) -> None:
        """Nobody waits."""
