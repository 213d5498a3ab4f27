"""`labapp devices test`: test a device, print the results, and keep them for support."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import labapp
from drivers.interfaces import Clock
from labapp.bench.opening import BenchFiles, BenchSetup, open_devices
from labapp.bench.selftest.camera_checks import DescribedCamera
from labapp.bench.selftest.checks import CheckResult, run_check, run_checks
from labapp.bench.selftest.role_checks import device_checks
from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.files.writing import require_writable, write_atomically


def run_selftest(
    role: str,
    bench: Path | None,
    scene: Path | None,
    report: Path | None,
    *,
    as_json: bool,
    force: bool,
) -> bool:
    """Test a device, print the results, and return whether all is well.

    `report` is the file for the same results as JSON. A device that doesn't open gives a failed
    check. Raises UserError for a wrong bench file, or a device that another application uses.
    """
    if report is not None:
        require_writable(report, force=force)
    setup = BenchFiles.with_defaults(bench, scene).read()
    camera = setup.bench.build_camera()
    described = setup.bench.devices.tables.get(role)
    options = described.options if described else {}
    told = DescribedCamera(camera.sensor, setup.bench.tells_clip_level, options, setup.source)
    found = _test_device(setup, role, told)
    assert described is not None
    data = {
        "device": role,
        "bench": setup.bench.name,
        "table": described.model_dump(),
        "well": all(one.passed for one in found),
        "labapp": labapp.__version__,
        "system": f"{platform.platform()}, Python {platform.python_version()}",
        "time": datetime.now().astimezone().isoformat(timespec="seconds"),
        "checks": [asdict(one) for one in found],
        "should_say": told.lines,
    }
    if report is not None:
        write_atomically(report, (json.dumps(data, indent=2) + "\n").encode())
    if as_json:
        print_json(data)
        return bool(data["well"])
    _print(role, described.driver, found, told.lines)
    if report is not None:
        out.print(f"wrote {report}: send it with your question")
    return bool(data["well"])


def _test_device(setup: BenchSetup, role: str, described: DescribedCamera) -> list[CheckResult]:
    with ExitStack() as stack:
        opened: list[tuple[Any, Clock]] = []

        def open_it() -> str:
            tables = setup.bench.devices.tables
            # A simulated camera sees what the simulated target changer places.
            both = role == "camera" and tables[role].is_simulated and tables["targets"].is_simulated
            roles = (role, "targets") if both else (role,)
            clock, devices = stack.enter_context(open_devices(setup, roles))
            if both and (lit := [name for name in devices["targets"].names if name != "dark"]):
                devices["targets"].place(lit[0])
            opened.append((devices[role], clock))
            return ""

        first = run_check("open", open_it)
        if not first.passed:
            return [first]
        progress = stack.enter_context(terminal_progress())
        device, clock = opened[0]
        return run_checks(device_checks(role, device, clock, described), progress)


def _print(role: str, driver: str, found: list[CheckResult], should_say: Sequence[str]) -> None:
    rows = [
        [one.check, "ok" if one.passed else "FAILED", f"{one.seconds:.2f}", one.detail]
        for one in found
    ]
    print_table(f"Self-test of the {role} ({driver})", ["check", "", "seconds ", "seen"], rows)
    failed = sum(not one.passed for one in found)
    verdict = f"{failed} of {len(found)} checks FAILED" if failed else f"all {len(found)} passed"
    out.print(verdict, style="bold red" if failed else "bold")
    if should_say:
        out.print("The bench file should say:")
    for line in should_say:
        out.print(f"    {line}", markup=False, highlight=False, soft_wrap=True)
