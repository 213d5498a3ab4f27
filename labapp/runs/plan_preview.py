"""The commands `labapp plan check` and `labapp plan show`: preview a plan on a bench."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.common.console import out, print_json, print_table, styled_line, terminal_progress
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.pattern_table import VideoPattern
from labapp.files.plan_file import NamedPlan, PlanFile
from labapp.patterns.grey_levels import compute_patterns
from labapp.runs.acquisition.feasibility import (
    RunEstimate,
    estimate_run,
    feasible_shots,
    longest_estimate,
    prompts_by_frame,
)
from labapp.runs.acquisition.frame_delays import measure_frame_delays
from labapp.runs.acquisition.frame_storage import UNTOLD, free_bytes, require_space
from labapp.runs.brackets.choice import possible_plans
from labapp.runs.bundled_plans import abbreviate_list, format_range
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import Readout
from labapp.runs.shots import Shot, ShotList, group_codes
from labapp.runs.steps import schedule_shots
from optics.progress import Progress


@dataclass(frozen=True)
class Preview:
    """What a plan takes on a bench.

    If exposures are to be chosen, shots and estimate are those in the brightest light that the
    camera can take, and most those that take longest and need most space. source: file of the plan.
    free: bytes that are free in the current folder.
    """

    plan: PlanFile
    source: Path
    bench: str
    simulated_devices: Sequence[str]
    capabilities: BenchCapabilities
    shots: ShotList
    estimate: RunEstimate
    most: RunEstimate
    free: int

    @property
    def steps(self) -> int:
        return len(np.unique(self.shots.column("step")))


def check_plan(
    named_plan: NamedPlan, bench: Path | None, scene: Path | None, *, as_json: bool
) -> None:
    """Print what the plan takes, and that the bench can do it; UserError if it can't.

    The patterns are computed on trial, with one iteration instead of many.
    """
    with open_bench(BenchFiles.with_defaults(bench, scene)) as opened:
        preview = preview_plan(named_plan.plan, named_plan.path, opened)
        _require_reconstruction_frames(preview)
        require_space(Path.cwd(), preview.estimate.disk_bytes)
        patterns = named_plan.plan.patterns.items()
        quick = {name: pattern.with_least_work() for name, pattern in patterns}
        with terminal_progress() as progress:
            folder, seed = named_plan.path.parent, named_plan.plan.seed
            compute_patterns(quick, opened.description, seed, progress, folder)
    if as_json:
        print_json(_as_data(preview))
        return
    _print_summary(preview)
    out.print(
        f"PASS. Run it with: labapp run {shell_word(named_plan.name)} --out run.h5",
        soft_wrap=True,
    )


def show_plan(
    named_plan: NamedPlan, bench: Path | None, scene: Path | None, *, every_row: bool, as_json: bool
) -> None:
    """Print what a plan takes, and its steps in order; raise UserError if the bench can't do it."""
    with open_bench(BenchFiles.with_defaults(bench, scene)) as opened:
        preview = preview_plan(named_plan.plan, named_plan.path, opened)
    prompts = prompts_by_frame(preview.shots, preview.capabilities)
    if as_json:
        frames = [_shot_data(shot, prompts.get(shot.index, "")) for shot in preview.shots]
        print_json(_as_data(preview) | {"shots": frames})
        return
    _print_summary(preview)
    _print_steps(preview, prompts, every_row)


def preview_plan(plan: PlanFile, source: Path, bench: Bench) -> Preview:
    """Preview a plan on an open bench; raise UserError if the bench can't do it.

    source: file of the plan.
    """
    abilities = BenchCapabilities.of(bench)
    possible = possible_plans(plan, abilities, bench.description.sensor, str(source))
    shots = [feasible_shots(one, abilities, str(source)) for one in possible]
    abilities = measure_frame_delays(bench, abilities, shots[0], Progress())
    shots = [schedule_shots(listed, abilities) for listed in shots]
    estimates = [
        estimate_run(listed, one, abilities) for listed, one in zip(shots, possible, strict=True)
    ]
    return Preview(
        plan,
        source,
        bench.file.name,
        bench.simulated_devices,
        abilities,
        shots[0],
        estimates[0],
        longest_estimate(estimates),
        free_bytes(Path.cwd()),
    )


def _require_reconstruction_frames(preview: Preview) -> None:
    """Raise UserError if the reconstruction lacks frames, or their wavelength is ambiguous."""
    roles = preview.plan.reconstruct
    if roles is None:
        return
    where = f"{preview.source}: key 'reconstruct'"
    parts = itertools.product((roles.star, roles.photograph), (roles.neutral, roles.coded))
    for target, pattern in parts:
        found = {
            shot.wavelength
            for shot in preview.shots.distinct("target", "pattern", "wavelength")
            if (shot.target, shot.pattern) == (target, pattern)
            and (roles.wavelength is None or abs(shot.wavelength - roles.wavelength) < 1e-11)
        }
        if not found:
            at = "" if roles.wavelength is None else f" at {roles.wavelength * 1e9:g} nm"
            raise UserError(
                f"{where} needs {target!r} with pattern {pattern!r}{at}, which no block takes. "
                "Add it to an [[acquire]] block."
            )
        if len(found) > 1:
            raise UserError(
                f"{where} lacks 'wavelength_nm', and {target!r} is taken at "
                f"{abbreviate_list(_nm(sorted(found)))} nm. Choose one."
            )


def _print_summary(preview: Preview) -> None:
    expected, most, asked = preview.estimate, preview.most, len(preview.estimate.prompts)
    badge = (
        f"SIMULATED: {', '.join(preview.simulated_devices)}"
        if preview.simulated_devices
        else "real devices"
    )
    person = f", besides what a person takes who is asked {asked} times" if asked else ""
    frames = _span(f"{expected.frames}", f"{most.frames}")
    steps = "" if preview.plan.has_brackets else f" in {preview.steps} steps"
    seconds = _span(_duration(expected.seconds), _duration(most.seconds))
    disk = _span(_size(expected.disk_bytes), _size(most.disk_bytes))
    free = "an untold amount" if preview.free == UNTOLD else _size(preview.free)
    lines = (
        f"{frames} frames{steps}",
        f"{seconds} of bench time{person}",
        f"{disk} on disk, {free} free in this folder",
        *_bracket_lines(preview.plan),
    )
    out.print(styled_line((preview.plan.title, "bold")))
    out.print(f"On {preview.bench}  {badge}")
    for line in lines:
        out.print(line)
    out.print()
    rows = [list(limit.values()) for limit in _limits(preview)]
    print_table("Asked for, and what this bench has", ["", "asked", "bench"], rows)


def _span(least: str, most: str) -> str:
    """Return a range in words; one number where both ends are alike."""
    return least if least == most else f"{least} to {most}"


def _bracket_lines(plan: PlanFile) -> list[str]:
    """Say which exposures are still to be chosen, or have been."""
    lines = []
    for number, block in enumerate(plan.acquire, 1):
        if block.bracket is not None:
            how = "by metering, before the record is made" if block.bracket.is_metered else "now"
            lines.append(
                f"exposures of block {number} are chosen {how}: {block.bracket.describe()}"
            )
        if block.chosen is not None:
            lines.append(f"exposures of block {number} were chosen: {block.chosen.describe()}")
    if any(block.bracket is not None and block.bracket.is_metered for block in plan.acquire):
        lines.append("what follows is for the brightest light that the camera takes")
    return lines


def _limits(preview: Preview) -> list[dict[str, str]]:
    """Say in words what a plan requests, and what the bench can do."""
    plan, abilities, listed = preview.plan, preview.capabilities, preview.shots
    exposures = [1e3 * seconds for seconds in np.unique(listed.column("exposure")).tolist()]
    wavelengths = _nm(np.unique(listed.column("wavelength")).tolist())
    slots = [f"{number}" for number in np.unique(listed.column("slot")).tolist() if number]
    videos = sum(isinstance(pattern, VideoPattern) for pattern in plan.patterns.values())
    gains = sorted({one.gain_db for one in listed.readouts if one.gain_db is not None})
    parts = [
        words
        for one in listed.readouts
        if (words := Readout(region=one.region, binning=one.binning).describe())
    ]
    low, high = _nm(abilities.wavelength_range)
    rows, columns = abilities.panel_shape
    asked_and_available = {
        "exposures": (
            f"{format_range(exposures)} ms",
            f"{format_range([end * 1e3 for end in abilities.exposure_range])} ms",
        ),
        "wavelengths": (f"{abbreviate_list(wavelengths)} nm", f"{low} to {high} nm"),
        "slots": (
            abbreviate_list(slots),
            f"1 to {len(abilities.slots)}: {abbreviate_list(_nm(abilities.slots))} nm",
        ),
        "gains": (
            f"{format_range(gains)} dB" if gains else "",
            f"{format_range(abilities.gain_range)} dB" if abilities.gain_range else "none",
        ),
        "regions and binnings": (
            abbreviate_list(dict.fromkeys(parts)),
            f"in {abilities.frame_shape[1]} x {abilities.frame_shape[0]} pixels",
        ),
        "targets": (
            abbreviate_list(dict.fromkeys(shot.place for shot in listed.distinct("target"))),
            ", ".join(abilities.targets),
        ),
        "patterns": (
            f"{len(plan.patterns)}" + (f", {videos} of them videos" if videos else ""),
            f"{columns} x {rows} pixels, {1 / abilities.video_frame:g} frames a second",
        ),
    }
    return [
        {"what": what, "asked": asked, "available": available}
        for what, (asked, available) in asked_and_available.items()
        if asked
    ]


def _print_steps(preview: Preview, prompts: dict[int, str], every_row: bool) -> None:
    """Print the steps in tables; each prompt begins a new table, and is its heading.

    Unless `every_row` is set, only the first 40 rows are printed.
    """
    wheel = bool(preview.shots.column("slot").any())
    columns = ["step", "role", "target", "pattern", "nm ", "exposures ms ", "frames ", "due s "]
    columns[5:5] = ["slot "] if wheel else []
    read = any(one.describe() for one in preview.shots.readouts)
    columns[-3:-3] = ["read"] if read else []
    groups = _groups(preview.shots)
    printed = groups if every_row else groups[:40]
    heading, rows = "Steps", list[list[Any]]()
    for which in printed:
        group = preview.shots[which]
        if text := prompts.get(group[0].index):
            if rows:
                print_table(heading, columns, rows)
            heading, rows = text, []
        rows.append(_row(group, wheel, read))
    print_table(heading, columns, rows)
    if len(groups) > len(printed):
        out.print(f"... and {len(groups) - len(printed)} more rows; --all prints them")


def _groups(listed: ShotList) -> list[slice]:
    """Group consecutive shots that differ only in exposure and repeat."""
    names = ("role", "target", "pattern", "wavelength", "slot", "readout")
    codes = group_codes(*(listed.column(name) for name in names))
    ends = [*(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(listed)]
    return [slice(first, last) for first, last in zip([0, *ends], ends, strict=False)]


def _row(group: Sequence[Shot], wheel: bool, read: bool) -> list[Any]:
    first, steps = group[0], sorted({shot.step for shot in group})
    exposures = dict.fromkeys(f"{shot.exposure * 1e3:g}" for shot in group)
    return [
        f"{steps[0]}" if len(steps) == 1 else f"{steps[0]}-{steps[-1]}",
        first.role,
        first.target,
        first.pattern,
        f"{first.wavelength * 1e9:g}",
        *([first.slot] if wheel else []),
        *([first.readout.describe()] if read else []),
        " ".join(exposures),
        len(group),
        f"{first.start_time:.3f}",
    ]


def _as_data(preview: Preview) -> dict[str, Any]:
    expected = preview.estimate
    return {
        "plan": str(preview.source),
        "title": preview.plan.title,
        "bench": preview.bench,
        "simulated": list(preview.simulated_devices),
        "steps": preview.steps,
        "frames": expected.frames,
        "seconds": expected.seconds,
        "prompts": list(expected.prompts),
        "disk_bytes": expected.disk_bytes,
        "most_frames": preview.most.frames,
        "most_seconds": preview.most.seconds,
        "most_disk_bytes": preview.most.disk_bytes,
        "free_bytes": preview.free,
        "limits": _limits(preview),
    }


def _shot_data(shot: Shot, prompt: str) -> dict[str, Any]:
    """Return a planned shot as plain data, with the prompt before it."""
    return {
        "frame": shot.index,
        "step": shot.step,
        "repeat": shot.repeat,
        "role": shot.role,
        "target": shot.target,
        "place": shot.place,
        "prompt": prompt,
        "pattern": shot.pattern,
        "wavelength_nm": round(shot.wavelength * 1e9, 3),
        "slot": shot.slot,
        "readout": shot.readout.as_data(),
        "exposure_ms": round(shot.exposure * 1e3, 3),
        "due_s": shot.start_time,
        "lasts_s": shot.duration,
    }


def _nm(wavelengths: Iterable[float]) -> list[str]:
    return [f"{metres * 1e9:g}" for metres in wavelengths]


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _size(count: int) -> str:
    if count < 1e9:
        return f"{count / 1e6:.{0 if count >= 1e7 else 1}f} MB"
    return f"{count / 1e9:.1f} GB"
