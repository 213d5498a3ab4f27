"""The command `labapp show`: print the contents of a record."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from labapp.common.console import out, print_json, print_table, styled_line
from labapp.runs.effect_plan_tables import show_effects
from labapp.runs.record import layout
from labapp.runs.record.reader import Record
from labapp.runs.recorded_calibrations import calibrations_in_force


def show_record(path: Path, *, as_json: bool) -> None:
    """Print a summary of a run's record: state, frames, devices, simulator decisions and log."""
    with Record(path) as record:
        data = record_data(record)
    if as_json:
        print_json(data)
        return
    badge = f"SIMULATED: {', '.join(data['simulated'])}" if data["simulated"] else "real devices"
    out.print(styled_line((data["title"], "bold"), f"  {data['state']}  ", (badge, "yellow")))
    out.print(f"{data['stored']} of {data['frames']} frames stored, {data['size']}")
    out.print(f"started {data['start_time']}, ended {data['end_time'] or 'not yet'}")
    out.print(f"expected {data['expected_s']:.1f} s of bench time, on a {data['clock']} clock")
    for line in data["calibrations"]:
        out.print(line, markup=False)
    if data["digest"]:
        out.print(f"digest {data['digest']}", soft_wrap=True)
    if data["retried"]:
        out.print(f"frames that needed more than one attempt: {data['retried']}")
    if data["missing"]:
        out.print(styled_line((f"missing frames: {data['missing']}", "red")))
    if data["message"]:
        out.print(data["message"])
    out.print()
    columns = ["role", "target", "pattern", "wavelength nm ", "exposures ms ", "frames "]
    print_table("Frames", columns, [list(group.values()) for group in data["groups"]])
    devices = [[name, *device.values()] for name, device in data["devices"].items()]
    print_table("Devices", ["device", "model", "serial", "simulated"], devices)
    if data["effect_plan"]:
        show_effects(data["effect_plan"])
    print_table("Log", ["bench time s ", ""], [[f"{t:.3f}", text] for t, text in data["log"]])


def record_data(record: Record) -> dict[str, Any]:
    """Return a summary of a run's record as plain data."""
    stored = record.column("stored").astype(bool)
    rows, columns = record.image(0).shape
    return {
        "record": str(record.path),
        "title": record.text("title"),
        "state": record.state.value,
        "message": record.message,
        "simulated": record.simulated_devices,
        "frames": record.frame_count,
        "stored": int(stored.sum()),
        "missing": record.missing_frames(),
        "size": f"{columns} x {rows} pixels",
        "seed": record.seed,
        "start_time": record.text("start_time"),
        "end_time": record.end_time,
        "digest": record.closing_digest,
        "clock": record.text("clock"),
        "expected_s": record.expected_seconds,
        "retried": np.flatnonzero(record.column("attempts") > 1).tolist(),
        "groups": _groups(record),
        "devices": record.devices,
        "calibrations": calibrations_in_force(record),
        "faults": record.faults,
        "effect_plan": record.effect_plan,
        "versions": record.versions,
        "log": record.log,
    }


def _groups(record: Record) -> list[dict[str, Any]]:
    """Group the planned frames of a run's record by role, target, pattern and wavelength."""
    targets, patterns = record.target_names, record.pattern_names
    columns = ("role", "target", "pattern", "wavelength_asked", "exposure_asked")
    exposures: dict[tuple[Any, ...], list[float]] = {}
    values = (record.column(name).tolist() for name in columns)
    for role, target, pattern, w, t in zip(*values, strict=True):
        key = layout.ROLES[role], targets[target], patterns[pattern], round(w * 1e9, 3)
        exposures.setdefault(key, []).append(t * 1e3)
    return [
        dict(zip(("role", "target", "pattern", "wavelength_nm"), key, strict=True))
        | {"exposures_ms": ", ".join(f"{ms:g}" for ms in sorted(set(taken))), "frames": len(taken)}
        for key, taken in exposures.items()
    ]
