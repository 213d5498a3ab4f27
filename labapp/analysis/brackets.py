"""Merging the exposures of a record, with its own dark frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.record.reader import Record
from optics import hdr
from optics.camera import Sensor
from optics.progress import Progress

Picture = NDArray[np.float64]


@dataclass(frozen=True)
class Bracket:
    """The merged exposures of one target with one pattern.

    rate, variance: electrons per second and pixel. clipped, dark: share of pixels that
    are so in every exposure. clipped_by_exposure: share at full scale.
    histogram: counts of digital numbers, one row an exposure.
    """

    target: str
    pattern: str
    exposures: list[float]
    rate: Picture
    variance: Picture
    clipped: float
    dark: float
    clipped_by_exposure: list[float]
    histogram: NDArray[np.int64]


def merge_all(record: Record, plan: PlanFile, progress: Progress) -> list[Bracket]:
    """Every target with every pattern of a record, but the dark frames themselves."""
    sensor = record.bench.build_camera().sensor
    dark = plan.reconstruct.dark if plan.reconstruct else "dark"
    pairs = [
        (target, pattern)
        for target in record.target_names
        for pattern in record.pattern_names
        if target != dark and record.select(target=target, pattern=pattern)
    ]
    merged = []
    for number, (target, pattern) in enumerate(pairs):
        progress.report(number / len(pairs), f"merging {target}, {pattern}")
        merged.append(_merge(record, target, pattern, dark, sensor))
    return merged


def _merge(record: Record, target: str, pattern: str, dark: str, sensor: Sensor) -> Bracket:
    """One bracket: every frame is an exposure, less the mean dark frame of its exposure."""
    indices = record.select(target=target, pattern=pattern)
    exposures = record.column("exposure")[indices]
    frames = np.stack([record.image(i) for i in indices])
    darks = {t: _mean_dark(record, dark, t, sensor) for t in sorted(set(exposures.tolist()))}
    merged = hdr.merge(
        torch.from_numpy(frames.astype(np.int32)),
        torch.from_numpy(exposures),
        torch.from_numpy(np.stack([darks[t][0] for t in exposures.tolist()])),
        torch.tensor([darks[t][1] for t in exposures.tolist()]),
        sensor,
    )
    state = merged.state.numpy()
    unique = sorted(darks)
    by_exposure = [frames[exposures == t] for t in unique]
    return Bracket(
        target,
        pattern,
        unique,
        merged.rate.numpy(),
        merged.variance.numpy(),
        float((state == hdr.CLIPPED).mean()),
        float((state == hdr.DARK).mean()),
        [float((f >= sensor.full_scale).mean()) for f in by_exposure],
        np.stack([np.bincount(f.ravel(), minlength=2**sensor.bits) for f in by_exposure]),
    )


def _mean_dark(record: Record, dark: str, exposure: float, sensor: Sensor) -> tuple[Picture, int]:
    """The mean dark frame of an exposure and how many it is of.

    Without dark frames of this exposure, the sensor's black level stands in for them.
    """
    exposures = record.column("exposure")
    indices = [i for i in record.select(target=dark) if exposures[i] == exposure]
    if not indices:
        shape = record.image(0).shape
        level = sensor.black_level + sensor.dark_current * exposure / sensor.gain
        return np.full(shape, level), 1
    return np.mean([record.image(i) for i in indices], axis=0), len(indices)


def find(brackets: list[Bracket], target: str, pattern: str, path: Path) -> Bracket:
    """The bracket of a target and pattern; UserError names the record that lacks it."""
    for bracket in brackets:
        if (bracket.target, bracket.pattern) == (target, pattern):
            return bracket
    raise UserError(
        f"{path}: has no frames of {target!r} with pattern {pattern!r}, which the plan's "
        "[reconstruct] table names. Add them to the plan's [[acquire]] blocks."
    )
