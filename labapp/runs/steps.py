"""What a plan asks for, frame by frame, and when each is due."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import lcm
from typing import Any

from labapp.files.plan_file import AXES, Acquisition, Axis, InterleavedFrames, PlanFile, Role
from labapp.runs.capabilities import BenchCapabilities

AxisValues = Mapping[Axis, Any]
"""A value for every axis; wavelengths in metres with their slot, exposures in seconds."""


@dataclass(frozen=True)
class Shot:
    """One planned frame. index: in the record. step: of the plan. repeat: within the step.

    wavelength: metres. exposure: seconds. role: light, or what calibration frame it is.
    place: the target's name on the bench. prompt: what a person does before it is placed.
    slot: of a filter wheel; 0 sets the wavelength. start_time: seconds from the beginning of the
    run at which the exposure begins, if nothing goes wrong. duration: seconds that it takes,
    settling included.
    """

    index: int
    step: int
    repeat: int
    target: str
    pattern: str
    wavelength: float
    exposure: float
    role: Role = "light"
    place: str = ""
    prompt: str = ""
    slot: int = 0
    start_time: float = 0.0
    duration: float = 0.0


def planned_shots(plan: PlanFile, capabilities: BenchCapabilities) -> list[Shot]:
    """Every frame of a plan on a bench, in the order in which they are taken."""
    listed: list[Shot] = []
    for block in plan.acquire:
        first = max((shot.step for shot in listed), default=-1) + 1
        listed += _block_shots(block, plan, capabilities, first)
    listed = [replace(shot, index=index) for index, shot in enumerate(listed)]
    return _schedule_shots(listed, capabilities)


def block_exposures(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities
) -> list[float]:
    """The exposures of a block in seconds, whole microseconds as cameras count."""
    if block.exposures_ms is not None:
        return [round(ms * 1e3) / 1e6 for ms in block.exposures_ms]
    # A period of all videos, so that pictures of different patterns can be compared.
    frames = lcm(*(video.length for video in plan.videos(block).values()))
    return [round(n * frames * capabilities.video_frame * 1e6) / 1e6 for n in block.periods or ()]


def _block_shots(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities, first: int
) -> list[Shot]:
    """The frames of a block, calibration frames between them; steps count from `first`."""
    light = [
        _build_shot(setting, block.role, plan)
        for setting in _axis_combinations(block, plan, capabilities)
    ]
    listed: list[Shot] = []
    for number, shot in enumerate(light):
        for asked in block.interleave:
            if number % (asked.every or len(light)) == 0:
                group = light[number : number + (asked.every or len(light))]
                listed += _calibration_shots(asked, group, plan)
        listed.append(shot)
    return _assign_steps(listed, first)


def _axis_combinations(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities
) -> Iterator[AxisValues]:
    """Every combination of a block's axes, in its order; some axes may step together."""
    if block.slots is not None:
        wavelengths = [(n, capabilities.slots[n - 1]) for n in block.slots]
    else:
        wavelengths = [
            (0, capabilities.wavelength_in_metres(nm)) for nm in block.wavelengths_nm or ()
        ]
    values: dict[Axis, list[Any]] = {
        "target": list(block.targets),
        "pattern": list(block.patterns),
        "wavelength": wavelengths,
        "exposure": block_exposures(block, plan, capabilities),
        "repeat": list(range(block.repeats)),
    }
    order = [*block.order, *(axis for axis in AXES if axis not in block.order)]
    groups: list[tuple[Axis, ...]] = []
    for axis in order:
        group = next((g for g in block.together if axis in g), (axis,))
        if group not in groups:
            groups.append(group)
    rows = [list(zip(*(values[axis] for axis in group), strict=True)) for group in groups]
    for chosen in product(*rows):
        yield {
            axis: value
            for group, row in zip(groups, chosen, strict=True)
            for axis, value in zip(group, row, strict=True)
        }


def _build_shot(setting: AxisValues, role: Role, plan: PlanFile) -> Shot:
    slot, wavelength = setting["wavelength"]
    known = plan.targets.get(setting["target"])
    return Shot(
        index=0,
        step=0,
        repeat=setting["repeat"],
        target=setting["target"],
        pattern=setting["pattern"],
        wavelength=wavelength,
        exposure=setting["exposure"],
        role=role,
        place=(known.place if known else None) or setting["target"],
        prompt=known.prompt if known else "",
        slot=slot,
    )


def _calibration_shots(request: InterleavedFrames, group: list[Shot], plan: PlanFile) -> list[Shot]:
    """The calibration frames that a group of frames needs: each setting once, repeated."""
    needed: dict[Any, Shot] = {}
    for shot in group:
        made = _build_shot(
            {
                "target": shot.target
                if request.role == "neutral"
                else request.target or request.role,
                "pattern": request.pattern,
                "wavelength": (shot.slot, shot.wavelength),
                "exposure": shot.exposure,
                "repeat": 0,
            },
            request.role,
            plan,
        )
        # No light, no colour: darks of every exposure are enough.
        colour = None if request.role == "dark" else (made.slot, made.wavelength)
        needed.setdefault((made.target, colour, made.exposure), made)
    return [replace(shot, repeat=n) for shot in needed.values() for n in range(request.frames)]


def _assign_steps(listed: Iterable[Shot], first: int) -> list[Shot]:
    """With a step for every setting; a setting that comes again, repeat and all, is a new one.

    A frame's chance follows from step and repeat, so that no two frames may share both.
    """
    numbered: list[Shot] = []
    steps: dict[Any, int] = {}
    seen: Counter[Any] = Counter()
    for shot in listed:
        colour = (shot.slot, shot.wavelength)
        setting = (shot.role, shot.target, shot.pattern, colour, shot.exposure)
        came = setting, seen[setting, shot.repeat]
        seen[setting, shot.repeat] += 1
        numbered.append(replace(shot, step=steps.setdefault(came, first + len(steps))))
    return numbered


def _schedule_shots(listed: Iterable[Shot], capabilities: BenchCapabilities) -> list[Shot]:
    """With the moment at which each is due: what changes settles at once, then the exposure."""
    timed: list[Shot] = []
    now = 0.0
    before: Shot | None = None
    for shot in listed:
        settling = _settling_time(before, shot, capabilities)
        lasts = settling + shot.exposure + capabilities.readout
        timed.append(replace(shot, start_time=now + settling, duration=lasts))
        now, before = now + lasts, shot
    return timed


def _settling_time(before: Shot | None, shot: Shot, capabilities: BenchCapabilities) -> float:
    changes = (
        (lambda s: s.place, capabilities.target_settling),
        (lambda s: s.pattern, capabilities.slm_settling),
        (lambda s: (s.wavelength, s.slot), capabilities.filter_settling),
    )
    changed = [time for of, time in changes if before is None or of(before) != of(shot)]
    return max(changed, default=0.0)
