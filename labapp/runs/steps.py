"""What a plan asks for, frame by frame, and when each is due."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import lcm
from typing import Any

from labapp.files.plan_file import AXES, Acquisition, Axis, Interleaved, PlanFile, Role
from labapp.runs.abilities import Abilities

Setting = Mapping[Axis, Any]
"""A value for every axis; wavelengths in metres with their slot, exposures in seconds."""


@dataclass(frozen=True)
class Shot:
    """One planned frame. index: in the record. step: of the plan. repeat: within the step.

    wavelength: metres. exposure: seconds. role: light, or what calibration frame it is.
    place: the target's name on the bench. prompt: what a person does before it is placed.
    slot: of a filter wheel; 0 sets the wavelength. moment: seconds from the beginning of the
    run at which the exposure begins, if nothing goes wrong. lasts: seconds that it takes,
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
    moment: float = 0.0
    lasts: float = 0.0


def shots(plan: PlanFile, abilities: Abilities) -> list[Shot]:
    """Every frame of a plan on a bench, in the order in which they are taken."""
    listed: list[Shot] = []
    for block in plan.acquire:
        first = max((shot.step for shot in listed), default=-1) + 1
        listed += _block(block, plan, abilities, first)
    listed = [replace(shot, index=index) for index, shot in enumerate(listed)]
    return _timed(listed, abilities)


def exposures(block: Acquisition, plan: PlanFile, abilities: Abilities) -> list[float]:
    """The exposures of a block in seconds, whole microseconds as cameras count."""
    if block.exposures_ms is not None:
        return [round(ms * 1e3) / 1e6 for ms in block.exposures_ms]
    # A period of all videos, so that pictures of different patterns can be compared.
    frames = lcm(*(video.length for video in plan.videos(block).values()))
    return [round(n * frames * abilities.video_frame * 1e6) / 1e6 for n in block.periods or ()]


def _block(block: Acquisition, plan: PlanFile, abilities: Abilities, first: int) -> list[Shot]:
    """The frames of a block, calibration frames between them; steps count from `first`."""
    light = [_shot(setting, block.role, plan) for setting in _settings(block, plan, abilities)]
    listed: list[Shot] = []
    for number, shot in enumerate(light):
        for asked in block.interleave:
            if number % (asked.every or len(light)) == 0:
                group = light[number : number + (asked.every or len(light))]
                listed += _calibration(asked, group, plan)
        listed.append(shot)
    return _numbered(listed, first)


def _settings(block: Acquisition, plan: PlanFile, abilities: Abilities) -> Iterator[Setting]:
    """Every combination of a block's axes, in its order; some axes may step together."""
    if block.slots is not None:
        wavelengths = [(n, abilities.slots[n - 1]) for n in block.slots]
    else:
        wavelengths = [(0, abilities.metres(nm)) for nm in block.wavelengths_nm or ()]
    values: dict[Axis, list[Any]] = {
        "target": list(block.targets),
        "pattern": list(block.patterns),
        "wavelength": wavelengths,
        "exposure": exposures(block, plan, abilities),
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


def _shot(setting: Setting, role: Role, plan: PlanFile) -> Shot:
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


def _calibration(asked: Interleaved, group: list[Shot], plan: PlanFile) -> list[Shot]:
    """The calibration frames that a group of frames needs: each setting once, repeated."""
    needed: dict[Any, Shot] = {}
    for shot in group:
        made = _shot(
            {
                "target": shot.target if asked.role == "neutral" else asked.target or asked.role,
                "pattern": asked.pattern,
                "wavelength": (shot.slot, shot.wavelength),
                "exposure": shot.exposure,
                "repeat": 0,
            },
            asked.role,
            plan,
        )
        # No light, no colour: darks of every exposure are enough.
        colour = None if asked.role == "dark" else (made.slot, made.wavelength)
        needed.setdefault((made.target, colour, made.exposure), made)
    return [replace(shot, repeat=n) for shot in needed.values() for n in range(asked.frames)]


def _numbered(listed: Iterable[Shot], first: int) -> list[Shot]:
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


def _timed(listed: Iterable[Shot], abilities: Abilities) -> list[Shot]:
    """With the moment at which each is due: what changes settles at once, then the exposure."""
    timed: list[Shot] = []
    now = 0.0
    before: Shot | None = None
    for shot in listed:
        settling = _settling(before, shot, abilities)
        lasts = settling + shot.exposure + abilities.readout
        timed.append(replace(shot, moment=now + settling, lasts=lasts))
        now, before = now + lasts, shot
    return timed


def _settling(before: Shot | None, shot: Shot, abilities: Abilities) -> float:
    changes = (
        (lambda s: s.place, abilities.target_settling),
        (lambda s: s.pattern, abilities.slm_settling),
        (lambda s: (s.wavelength, s.slot), abilities.filter_settling),
    )
    changed = [time for of, time in changes if before is None or of(before) != of(shot)]
    return max(changed, default=0.0)
