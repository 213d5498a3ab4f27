"""Expand a plan into its shots, frame by frame, with the time at which each is due."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import lcm
from typing import Any

from labapp.files.plan_file import AXES, Acquisition, Axis, InterleavedFrames, PlanFile, Role
from labapp.files.quantities import exposure_from_ms, round_exposure
from labapp.runs.capabilities import BenchCapabilities

AxisValues = Mapping[Axis, Any]
"""A value for every axis of a plan's block. Wavelengths are (slot, metres), exposures seconds."""


@dataclass(frozen=True)
class Shot:
    """One planned frame of a run, with all of its settings.

    Attributes
    ----------
    index : int
        Number of the frame in the record.
    step, repeat : int
        Step of the plan, and number of the frame within the step.
    target, pattern : str
        Names of target and pattern in the plan.
    wavelength : float
        Metres.
    exposure : float
        Exposure time in seconds.
    role : str
        "light", or the kind of calibration frame.
    place : str
        Name of the target on the bench; "" leaves the one that is there.
    prompt : str
        What a person is asked to do before the target is placed.
    slot : int
        Slot of a filter wheel, from 1; 0 means that the wavelength is set.
    start_time : float
        Planned beginning of the exposure, in seconds from the beginning of the run.
    duration : float
        Seconds that the frame takes, settling included.
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
    """Return the shots of a plan's run on a bench, in the order in which they are taken."""
    listed: list[Shot] = []
    for block in plan.acquire:
        first = max((shot.step for shot in listed), default=-1) + 1
        listed += _block_shots(block, plan, capabilities, first)
    listed = [replace(shot, index=index) for index, shot in enumerate(listed)]
    return schedule_shots(listed, capabilities)


def planned_settings(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities
) -> list[Shot]:
    """Return one shot of a run for each target, pattern and wavelength of a block of its plan.

    Their exposures, and calibration frames, are left out.
    """
    alone = {"bracket": None, "periods": None, "exposures_ms": (1.0,)}
    single = {"repeats": 1, "interleave": (), "together": _without_exposure(block)}
    each = block.model_copy(update=alone | single)
    return planned_shots(plan.model_copy(update={"acquire": (each,)}), capabilities)


def _without_exposure(block: Acquisition) -> tuple[tuple[Axis, ...], ...]:
    """Return the axes of a run's block that step together, without exposures and repeats."""
    kept = [tuple(a for a in group if a not in ("exposure", "repeat")) for group in block.together]
    return tuple(group for group in kept if len(group) > 1)


def block_exposures(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities
) -> list[float]:
    """Return the exposures for a block of a run's plan, in seconds.

    The exposures are rounded to microseconds, as in cameras. Those of a bracket must be settled.
    """
    assert block.bracket is None, "the exposures of a bracket are chosen before shots are planned"
    if block.exposures_ms is not None:
        return [exposure_from_ms(ms) for ms in block.exposures_ms]
    # Periods are those common to all videos, so that frames of different patterns compare.
    frames = lcm(*(video.length for video in plan.videos(block).values()))
    return [round_exposure(n * frames * capabilities.video_frame) for n in block.periods or ()]


def _block_shots(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities, first: int
) -> list[Shot]:
    """Return a run's shots for a block of its plan, with calibration shots, from step `first`."""
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
    """Yield all combinations of a plan block's axis values in the order of a run's shots.

    Axes of the same group step together.
    """
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
    """Return a run's calibration shots for a group of shots: each needed setting, with repeats."""
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
        # Dark frames don't depend on the wavelength, so one for each exposure is enough.
        colour = None if request.role == "dark" else (made.slot, made.wavelength)
        needed.setdefault((made.target, colour, made.exposure), made)
    return [replace(shot, repeat=n) for shot in needed.values() for n in range(request.frames)]


def _assign_steps(listed: Iterable[Shot], first: int) -> list[Shot]:
    """Number the steps of a run's shots from `first`; a step is a setting with its repeats.

    A setting that occurs again with the same repeat is a new step. The random numbers of a
    simulated frame depend on step and repeat, so no two frames may share both.
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


def schedule_shots(listed: Iterable[Shot], capabilities: BenchCapabilities) -> list[Shot]:
    """Plan the times of a run's shots: changed settings settle together before each exposure."""
    timed: list[Shot] = []
    now = 0.0
    before: Shot | None = None
    for shot in listed:
        settling, delay = _time_of_changes(before, shot, capabilities)
        delay += capabilities.delays.frame
        lasts = settling + shot.exposure + max(capabilities.readout + delay, 0.0)
        timed.append(replace(shot, start_time=now + settling, duration=lasts))
        now, before = now + lasts, shot
    return timed


def _time_of_changes(
    before: Shot | None, shot: Shot, capabilities: BenchCapabilities
) -> tuple[float, float]:
    """Return how long the settings that change between two shots of a run take.

    They are seconds of settling, as the devices document it, and of delay beyond that.
    """
    delays = capabilities.delays
    changes = (
        (lambda s: s.place, capabilities.target_settling, delays.target),
        (lambda s: s.pattern, capabilities.slm_settling, delays.slm),
        (lambda s: (s.wavelength, s.slot), capabilities.filter_settling, delays.filter),
    )
    changed = [
        (settling, delay)
        for of, settling, delay in changes
        if before is None or of(before) != of(shot)
    ]
    settling = max((one for one, _ in changed), default=0.0)
    return settling, max((one for _, one in changed), default=0.0)
