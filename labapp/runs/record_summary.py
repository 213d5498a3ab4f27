"""The command `labapp show`: print the contents of a record, with what the simulator did."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.console import out, print_json, print_table, styled_line
from labapp.files.frame_list import format_frame_list
from labapp.files.plan_file import ROLES
from labapp.runs.record.reader import Record
from labapp.runs.recorded_calibrations import calibrations_in_force, clip_level_in_force
from labapp.runs.shots import group_codes

_SHOWN_LINES = 500
"""Lines of the log that are printed: those of some hundred frames. Chosen."""


def show_record(path: Path, *, as_json: bool) -> None:
    """Print state, frames, devices, simulator decisions and log of a record."""
    with Record(path) as record:
        data = record_data(record)
        if as_json:
            print_json(data | {"log": record.log})
            return
        numbered = deque(enumerate(record.log_lines(), 1), maxlen=_SHOWN_LINES)
    badge = f"SIMULATED: {', '.join(data['simulated'])}" if data["simulated"] else "real devices"
    out.print(styled_line((data["title"], "bold"), f"  {data['state']}  ", (badge, "yellow")))
    out.print(f"{data['stored']} of {data['frames']} frames stored, {data['size']}")
    out.print(f"started {data['start_time']}, ended {data['end_time'] or 'not yet'}")
    out.print(f"expected {data['expected_s']:.1f} s of bench time, on a {data['clock']} clock")
    for line in [*data["calibrations"], data["clip_level"]]:
        out.print(line, markup=False)
    if data["digest"]:
        out.print(f"digest {data['digest']}", soft_wrap=True)
    if data["retried"]:
        out.print(f"frames that needed more than one attempt: {format_frame_list(data['retried'])}")
    if data["missing"]:
        out.print(styled_line((f"missing frames: {format_frame_list(data['missing'])}", "red")))
    if data["message"]:
        out.print(data["message"])
    out.print()
    # How frames are read is told where that was chosen.
    groups = data["groups"]
    read = ["read"] if any(group["readout"] for group in groups) else []
    columns = ["role", "target", "pattern", *read, "wavelength nm ", "exposures ms ", "frames "]
    rows = [[one for name, one in group.items() if read or name != "readout"] for group in groups]
    print_table("Frames", columns, rows)
    devices = [[name, *device.values()] for name, device in data["devices"].items()]
    print_table("Devices", ["device", "model", "serial", "simulated"], devices)
    if data["effect_plan"]:
        show_effects(data["effect_plan"])
    lines = [[f"{time:.3f}", text] for _, (time, text) in numbered]
    if lines and (count := numbered[-1][0]) > len(lines):
        out.print(f"The last {len(lines)} of {count} lines of the log; --json prints all:")
    print_table("Log", ["bench time s ", ""], lines)


def record_data(record: Record) -> dict[str, Any]:
    """Return all of the summary but the log as plain data."""
    stored = record.column("stored").astype(bool)
    rows, columns = record.frame_shape
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
        "clip_level": clip_level_in_force(record),
        "faults": record.faults,
        "effect_plan": record.effect_plan,
        "versions": record.versions,
    }


def _groups(record: Record) -> list[dict[str, Any]]:
    """Group the planned frames by role, target, pattern, wavelength and readout."""
    names = {"role": ROLES, "target": record.target_names, "pattern": record.pattern_names}
    names["readout"] = [one.describe() for one in record.readouts]
    if len(record.readouts) > 1:
        # These are the numbers that --readout takes.
        names["readout"] = [f"{n}: {one or 'whole'}" for n, one in enumerate(names["readout"])]
    nanometres = np.round(record.column("wavelength_asked") * 1e9, 3)
    codes = group_codes(*(record.column(name) for name in names), nanometres)
    _, firsts, counts = np.unique(codes, return_index=True, return_counts=True)
    exposures = _distinct_exposures(codes, record.column("exposure_asked"))
    return [
        {name: known[record.column(name)[firsts[group]]] for name, known in names.items()}
        | {
            "wavelength_nm": float(nanometres[firsts[group]]),
            "exposures_ms": ", ".join(f"{seconds * 1e3:g}" for seconds in exposures[group]),
            "frames": int(counts[group]),
        }
        for group in np.argsort(firsts)
    ]


def _distinct_exposures(
    codes: NDArray[np.int64], exposures: NDArray[np.float64]
) -> list[list[float]]:
    """Return the different exposures of each group of frames, in seconds, rising."""
    order = np.lexsort((exposures, codes))
    group, seconds = codes[order], exposures[order]
    new = np.concatenate(([True], (np.diff(group) != 0) | (np.diff(seconds) != 0)))
    listed: list[list[float]] = [[] for _ in range(int(group[-1]) + 1)]
    for number, one in zip(group[new].tolist(), seconds[new].tolist(), strict=True):
        listed[number].append(one)
    return listed


def show_effects(effect_plan: dict[str, Any]) -> None:
    """Print each simulated effect's levels and largest error."""
    if "plans" in effect_plan:
        _show_plans(effect_plan["plans"])
    else:
        _print_legacy_plans(effect_plan)


def _show_plans(plans: Sequence[dict[str, Any]]) -> None:
    count, tolerances = len(plans), sorted({plan["tol"] for plan in plans})
    pictures = f"{count} different pictures" if count > 1 else "its picture"
    names = dict.fromkeys(one["effect"] for plan in plans for one in plan["decisions"])
    tolerance = " and ".join(f"{tol:g}" for tol in tolerances)
    # Records from before there were estimates don't say what decided.
    estimated = any(plan.get("decided_by") == "estimate" for plan in plans)
    print_table(
        f"What the simulator did for {pictures}, tolerance {tolerance}",
        ["effect", "level", "likely " if estimated else "at most ", "why"],
        [_row(name, plans) for name in names],
    )
    worst = max(plans, key=lambda plan: _size(plan["error"]))
    out.print(
        f"All are within {format_share(worst['error'])} of everything on"
        f"{', as estimated' if estimated else ''}; the farthest is "
        f"{worst['target']}, {worst['pattern']}, {worst['wavelength_nm']:g} nm, "
        f"{worst['exposure_ms']:g} ms."
    )
    out.print()


def _row(name: str, plans: Sequence[dict[str, Any]]) -> list[str]:
    """Return an effect's row: levels, largest error bound, and reason."""
    found = [one for plan in plans for one in plan["decisions"] if one["effect"] == name]
    levels = list(dict.fromkeys(one["level"] for one in found))
    level = " or ".join(levels)
    if any(one["forced"] for one in found):
        level += ", forced"
    # Among equal bounds, take the plan with the largest estimated change of the picture.
    most = max(found, key=lambda one: (_size(one["relative"]), one["estimate"]))
    return [name, level, format_share(most["relative"]), most["why"]]


def format_share(value: float | None) -> str:
    """Format a picture's relative error; None means that it has no bound."""
    return "∞" if value is None else f"{value:.1e}" if value else "0"


def _size(value: float | None) -> float:
    return math.inf if value is None else value


def _print_legacy_plans(plans: dict[str, Any]) -> None:
    """Print the plans of an old record, which has only an estimate of each effect."""
    for name, plan in plans.items():
        rows = [
            [
                one["effect"],
                "on" if one["on"] else "off",
                f"{one['estimate']:.2g}",
                one["measure"],
                one["why"],
            ]
            for one in plan["decisions"]
        ]
        heading = f"What the simulator did for {name}, tolerance {plan['tol']:g}"
        print_table(heading, ["effect", "", "estimate ", "of", "why"], rows)
