"""Merging the exposures of a record, with its own dark frames."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.record.reader import Record
from optics import hdr
from optics.camera import Sensor
from optics.progress import Progress

Picture = NDArray[np.float64]


@dataclass(frozen=True)
class Bracket:
    """The merged exposures of one target with one pattern at one wavelength.

    wavelength: metres. rate, variance: electrons per second and pixel. clipped, dark:
    share of pixels that are so in every exposure. clipped_by_exposure: share at full
    scale. dark_frames: the fewest that an exposure's dark was averaged from; 0 where the
    sensor's black level stood in for them. histogram: counts of digital numbers, one row
    an exposure.
    """

    target: str
    pattern: str
    wavelength: float
    exposures: list[float]
    rate: Picture
    variance: Picture
    clipped: float
    dark: float
    clipped_by_exposure: list[float]
    dark_frames: int
    histogram: NDArray[np.int64]

    @property
    def name(self) -> str:
        return f"{self.target}, {self.pattern}, {self.wavelength * 1e9:g} nm"


def merge_all(
    record: Record, progress: Progress, targets: Collection[str] | None = None
) -> list[Bracket]:
    """Every target, pattern and wavelength of a record, but the dark frames themselves.

    targets: the only ones that are merged, if given.
    """
    sensor = record.bench.build_camera().sensor
    dark = dark_target(record.plan)
    wanted = [
        {"target": target, "pattern": pattern, "wavelength_asked": wavelength}
        for target in record.target_names
        for pattern in record.pattern_names
        for wavelength in sorted(set(record.column("wavelength_asked").tolist()))
        if target != dark and (targets is None or target in targets)
    ]
    found = [(one, indices) for one in wanted if (indices := record.select(**one))]
    merged = []
    for number, (one, indices) in enumerate(found):
        progress.report(number / len(found), f"merging {one['target']}, {one['pattern']}")
        merged.append(_merge(record, indices, dark, sensor))
    return merged


def merge_frame(record: Record, index: int) -> Bracket:
    """One frame by itself, as a bracket of one exposure."""
    sensor = record.bench.build_camera().sensor
    return _merge(record, [index], dark_target(record.plan), sensor)


def dark_target(plan: PlanFile) -> str:
    """The target of a plan's dark frames."""
    return plan.reconstruct.dark if plan.reconstruct else "dark"


def _merge(record: Record, indices: list[int], dark: str, sensor: Sensor) -> Bracket:
    """One bracket: every frame is an exposure, less the mean dark frame of its exposure."""
    first = indices[0]
    exposures = record.column("exposure")[indices]
    frames = np.stack([record.image(i) for i in indices])
    darks = {t: _mean_dark(record, dark, t, sensor) for t in sorted(set(exposures.tolist()))}
    counts = [darks[t][1] for t in exposures.tolist()]
    merged = hdr.merge_bracket(
        torch.from_numpy(frames.astype(np.int32)),
        torch.from_numpy(exposures),
        torch.from_numpy(np.stack([darks[t][0] for t in exposures.tolist()])),
        # A level from the data sheet has no noise of its own, like infinitely many frames.
        torch.tensor([float(count or math.inf) for count in counts]),
        sensor,
    )
    state = merged.state.numpy()
    by_exposure = [frames[exposures == t] for t in darks]
    return Bracket(
        target=record.target_names[record.column("target")[first]],
        pattern=record.pattern_names[record.column("pattern")[first]],
        wavelength=float(record.column("wavelength")[first]),
        exposures=list(darks),
        rate=merged.rate.numpy(),
        variance=merged.variance.numpy(),
        clipped=float((state == hdr.CLIPPED).mean()),
        dark=float((state == hdr.DARK).mean()),
        clipped_by_exposure=[float((f >= sensor.full_scale).mean()) for f in by_exposure],
        dark_frames=min(counts),
        histogram=np.stack([np.bincount(f.ravel(), minlength=2**sensor.bits) for f in by_exposure]),
    )


def _mean_dark(record: Record, dark: str, exposure: float, sensor: Sensor) -> tuple[Picture, int]:
    """The mean dark frame of an exposure and how many it is of.

    Without dark frames of this exposure, the sensor's data stand in for them: of 0 frames,
    and without noise of their own.
    """
    exposures = record.column("exposure")
    indices = [i for i in record.select(target=dark) if exposures[i] == exposure]
    if not indices:
        level = sensor.black_level + sensor.dark_current * exposure / sensor.gain
        return np.full(sensor.shape, level), 0
    return np.mean([record.image(i) for i in indices], axis=0), len(indices)


def find_bracket(
    brackets: list[Bracket], target: str, pattern: str, wavelength: float | None, path: Path
) -> Bracket:
    """The bracket of a target and pattern, at a wavelength in metres if one is given.

    UserError if the record at `path` lacks it, or has it at several wavelengths.
    """
    found = [
        bracket
        for bracket in brackets
        if (bracket.target, bracket.pattern) == (target, pattern)
        and (wavelength is None or abs(bracket.wavelength - wavelength) < 1e-11)
    ]
    if len(found) > 1:
        listed = ", ".join(f"{bracket.wavelength * 1e9:g}" for bracket in found)
        raise UserError(
            f"{path}: has {target!r} with pattern {pattern!r} at {listed} nm. Choose one with "
            "the key 'wavelength_nm' of the plan's [reconstruct] table."
        )
    if not found:
        at = "" if wavelength is None else f" at {wavelength * 1e9:g} nm"
        raise UserError(
            f"{path}: has no frames of {target!r} with pattern {pattern!r}{at}, which the plan's "
            "[reconstruct] table names. Add them to the plan's [[acquire]] blocks."
        )
    return found[0]
