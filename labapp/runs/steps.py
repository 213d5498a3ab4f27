"""Expand a plan into its shots, frame by frame, with the time at which each is due."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from math import lcm, prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.files.plan_file import AXES, ROLES, Acquisition, Axis, InterleavedFrames, PlanFile
from labapp.files.quantities import exposure_from_ms, round_exposure
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import Readout, block_readouts
from labapp.runs.shots import Shot, ShotList, ShotTarget, group_codes

Columns = dict[str, NDArray[Any]]
"""Columns of a ShotList by name."""


def planned_shots(plan: PlanFile, capabilities: BenchCapabilities) -> ShotList:
    """Return the shots of a plan on a bench, in the order in which they are taken."""
    names = _Names(plan)
    blocks: list[Columns] = []
    steps = 0
    for block in plan.acquire:
        columns = _block_columns(block, plan, capabilities, names)
        columns["step"] = _steps(columns) + np.uint32(steps)
        steps = int(columns["step"].max()) + 1
        blocks.append(columns)
    joined = blocks[0]
    if len(blocks) > 1:
        joined = {name: np.concatenate([one[name] for one in blocks]) for name in blocks[0]}
    joined["index"] = np.arange(len(joined["step"]), dtype=np.int32)
    listed = ShotList(
        joined,
        [names.target(name) for name in names.targets],
        list(names.patterns),
        list(names.readouts),
    )
    return schedule_shots(listed, capabilities)


def planned_settings(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities
) -> ShotList:
    """Return one shot for each target, pattern and wavelength of a block.

    Their exposures, and calibration frames, are left out.
    """
    # What steps together does so without exposures and repeats.
    kept = [tuple(a for a in group if a not in ("exposure", "repeat")) for group in block.together]
    together = tuple(group for group in kept if len(group) > 1)
    alone = {"bracket": None, "periods": None, "exposures_ms": (1.0,)}
    single = {"repeats": 1, "interleave": (), "together": together}
    each = block.model_copy(update=alone | single)
    return planned_shots(plan.model_copy(update={"acquire": (each,)}), capabilities)


def block_exposures(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities
) -> list[float]:
    """Return the exposures of a block in seconds, rounded to microseconds, as in cameras.

    Those of a bracket must be settled.
    """
    assert block.bracket is None, "the exposures of a bracket are chosen before shots are planned"
    if block.exposures_ms is not None:
        return [exposure_from_ms(ms) for ms in block.exposures_ms]
    # Periods are those common to all videos, so that frames of different patterns compare.
    frames = lcm(*(video.length for video in plan.videos(block).values()))
    return [round_exposure(n * frames * capabilities.video_frame) for n in block.periods or ()]


class _Names:
    """What shots have indices for: names of targets and patterns, and readouts."""

    def __init__(self, plan: PlanFile) -> None:
        self._plan = plan
        targets = (
            name
            for block in plan.acquire
            for name in (*block.targets, *(one.target or one.role for one in block.interleave))
        )
        self.targets = {name: number for number, name in enumerate(dict.fromkeys(targets))}
        self.patterns = {name: number for number, name in enumerate(plan.patterns)}
        self.readouts: dict[Readout, int] = {}

    def target(self, name: str) -> ShotTarget:
        known = self._plan.targets.get(name)
        return ShotTarget(
            name, (known.place if known else None) or name, known.prompt if known else ""
        )


def _block_columns(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities, names: _Names
) -> Columns:
    """Return the shots of a block, with the calibration shots among them.

    They are sorted by the light shot before which each is taken, then by the place of its table
    among those of the block's calibration frames, light last, then by the light shot whose settings
    it has, and by repeat.
    """
    light = _light_columns(block, plan, capabilities, names)
    if not block.interleave:
        return light
    count = len(light["target"])
    parts = [light]
    orders = [(np.arange(count), np.full(count, len(block.interleave)), np.zeros(count, np.int64))]
    for number, asked in enumerate(block.interleave):
        first, anchor = _needed(asked, light)
        made = _calibration_columns(asked, light, first, names)
        parts.append(made)
        rows = np.repeat(first, asked.frames)
        orders.append((np.repeat(anchor, asked.frames), np.full(len(rows), number), rows))
    anchors, tables, rows = (np.concatenate(one) for one in zip(*orders, strict=True))
    repeats = np.concatenate([one["repeat"] for one in parts])
    order = np.lexsort((repeats, rows, tables, anchors))
    return {name: np.concatenate([one[name] for one in parts])[order] for name in light}


def _light_columns(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities, names: _Names
) -> Columns:
    """Return all combinations of a block's axis values in the order of the shots.

    Axes of the same group step together.
    """
    if block.slots is not None:
        slots = list(block.slots)
        wavelengths = [capabilities.slots[number - 1] for number in slots]
    else:
        wavelengths = [capabilities.wavelength_in_metres(nm) for nm in block.wavelengths_nm or ()]
        slots = [0] * len(wavelengths)
    at = _axis_indices(block)
    count = len(at["target"])
    exposures = np.array(block_exposures(block, plan, capabilities))
    readouts = [
        names.readouts.setdefault(one, len(names.readouts))
        for one in block_readouts(block, capabilities)
    ]
    binned = at["region"] * block.length("binning") + at["binning"]
    return {
        "target": _codes(names.targets, block.targets)[at["target"]],
        "pattern": _codes(names.patterns, block.patterns)[at["pattern"]],
        "wavelength": np.array(wavelengths)[at["wavelength"]],
        "slot": np.array(slots, np.uint16)[at["wavelength"]],
        "readout": np.array(readouts, np.uint16)[binned * block.length("gain") + at["gain"]],
        "exposure": exposures[at["exposure"]],
        "repeat": at["repeat"].astype(np.uint32),
        "role": np.full(count, ROLES.index(block.role), np.uint8),
    }


def _axis_indices(block: Acquisition) -> dict[Axis, NDArray[np.intp]]:
    """Return the index on each axis of a block, for all shots in their order."""
    order = [*block.order, *(axis for axis in AXES if axis not in block.order)]
    groups: list[tuple[Axis, ...]] = []
    for axis in order:
        group = next((g for g in block.together if axis in g), (axis,))
        if group not in groups:
            groups.append(group)
    lengths = [block.length(group[0]) for group in groups]
    numbers = np.arange(prod(lengths))
    # How many shots have the same index before the next: those of all faster axes.
    same = list(accumulate(reversed(lengths), lambda a, b: a * b, initial=1))[-2::-1]
    return {
        axis: numbers // span % length
        for group, length, span in zip(groups, lengths, same, strict=True)
        for axis in group
    }


def _codes(known: Mapping[str, int], names: Sequence[str]) -> NDArray[np.uint16]:
    return np.array([known[name] for name in names], np.uint16)


def _needed(asked: InterleavedFrames, light: Columns) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the shots that need calibration frames, each setting once a group.

    Also the number of the shot before which each is taken: the first of its group.
    """
    count = len(light["target"])
    size = asked.every or count
    groups = np.arange(count) // size
    alike = [groups, light["exposure"], light["readout"]]
    if asked.role == "neutral":
        alike.append(light["target"])
    # Dark frames don't depend on the wavelength, so one for each exposure is enough.
    if asked.role != "dark":
        alike += [light["wavelength"], light["slot"]]
    first = np.sort(np.unique(group_codes(*alike), return_index=True)[1])
    return first, groups[first] * size


def _calibration_columns(
    asked: InterleavedFrames, light: Columns, first: NDArray[np.intp], names: _Names
) -> Columns:
    """Return the calibration shots for the shots that need them, with repeats."""
    made = {name: np.repeat(column[first], asked.frames) for name, column in light.items()}
    if asked.role != "neutral":
        made["target"][:] = names.targets[asked.target or asked.role]
    made["pattern"][:] = names.patterns[asked.pattern]
    made["role"][:] = ROLES.index(asked.role)
    made["repeat"] = np.tile(np.arange(asked.frames, dtype=np.uint32), len(first))
    return made


def _steps(columns: Columns) -> NDArray[np.uint32]:
    """Number the steps from 0 on; a step is a setting with its repeats.

    A setting that occurs again with the same repeat is a new step. The random numbers of a
    simulated frame depend on step and repeat, so no two frames may share both.
    """
    named = ("role", "target", "pattern", "slot", "wavelength", "exposure", "readout")
    settings = group_codes(*(columns[name] for name in named))
    came = group_codes(settings, _occurrences(group_codes(settings, columns["repeat"])))
    _, first, inverse = np.unique(came, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first)).astype(np.uint32)[inverse]


def _occurrences(codes: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return how often each shot's number has occurred before."""
    order = np.argsort(codes, kind="stable")
    ordered = codes[order]
    numbers = np.arange(len(codes))
    begins = np.concatenate(([True], ordered[1:] != ordered[:-1]))
    found = np.empty(len(codes), np.intp)
    found[order] = numbers - np.maximum.accumulate(np.where(begins, numbers, 0))
    return found


def schedule_shots(shots: Iterable[Shot], capabilities: BenchCapabilities) -> ShotList:
    """Plan the times of shots: changed settings settle together before each exposure."""
    listed = ShotList.of(shots)
    changes = _changes(listed)
    settling, after = (times[changes] for times in _times_of_changes(capabilities))
    averaged = np.array([one.averaged for one in listed.readouts])[listed.column("readout")]
    lasts = settling + averaged * listed.column("exposure")
    lasts += after + (averaged - 1) * max(capabilities.readout + capabilities.delays.frame, 0.0)
    begins = np.empty_like(lasts)
    np.cumsum(lasts[:-1], out=begins[1:])
    begins[:1] = 0.0
    begins += settling
    return listed.with_columns(start_time=begins, duration=lasts)


def _changes(listed: ShotList) -> NDArray[np.uint8]:
    """Return what changes before each shot: 1 target + 2 pattern + 4 wavelength."""
    places: dict[str, int] = {}
    numbers = [places.setdefault(one.place, len(places)) for one in listed.targets]
    place = np.array(numbers, np.uint16)[listed.column("target")]
    found = np.full(len(listed), 7, np.uint8)
    found[1:] = place[1:] != place[:-1]
    for bit, names in ((2, ("pattern",)), (4, ("wavelength", "slot"))):
        changed = np.zeros(max(len(listed) - 1, 0), np.uint8)
        for column in map(listed.column, names):
            changed |= column[1:] != column[:-1]
        found[1:] += changed * np.uint8(bit)
    return found


def _times_of_changes(
    capabilities: BenchCapabilities,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how long the changes before a shot take, for each number of _changes().

    They are seconds of settling, as the devices document it, and those after the exposure: of
    readout, and of delays beyond what is documented.
    """
    of, delays = capabilities, capabilities.delays
    settling = (of.target_settling, of.slm_settling, of.filter_settling)
    delay = (delays.target, delays.slm, delays.filter)
    settles, afters = [], []
    for changes in range(8):
        changed = [bit for bit in range(3) if changes >> bit & 1]
        settles.append(max((settling[bit] for bit in changed), default=0.0))
        late = max((delay[bit] for bit in changed), default=0.0) + delays.frame
        afters.append(max(of.readout + late, 0.0))
    return np.array(settles), np.array(afters)
