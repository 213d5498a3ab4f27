"""Merge the exposure brackets of a record, with its own dark frames."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.record.reader import Record
from optics import hdr
from optics.camera import Sensor
from optics.progress import Progress

Picture = NDArray[np.float64]

WAVELENGTH_TOLERANCE = 1e-11
"""Difference in metres below which two wavelengths count as the same."""

_REACH = 2
"""Pixels of the same colour to either side from which a defective one is filled. Chosen."""


@dataclass(frozen=True)
class _Frames:
    """What frames are of: target and pattern by their names in the plan, and wavelength, metres."""

    target: str
    pattern: str
    wavelength: float

    @property
    def name(self) -> str:
        """Name target, pattern and wavelength in words."""
        return f"{self.target}, {self.pattern}, {self.wavelength * 1e9:g} nm"


@dataclass(frozen=True)
class Bracket(_Frames):
    """The merged exposures of one target with one pattern at one wavelength.

    exposures: exposure times, seconds.
    rate, variance: (rows, columns), electrons per second and pixel, and the variance of this rate.
    clipped, dark: share of pixels that are clipped, or dark, in every exposure.
    clipped_by_exposure: share of pixels at full scale in each exposure.
    dark_frames: fewest dark frames that were averaged for an exposure; 0 where the sensor's black
        level was used instead.
    histogram: (exposures, levels), how many pixels have each digital number.
    defects: (rows, columns), pixels that the camera's calibration lists as defective, whose values
        were filled from around them; None if none are known.
    """

    exposures: list[float]
    rate: Picture
    variance: Picture
    clipped: float
    dark: float
    clipped_by_exposure: list[float]
    dark_frames: int
    histogram: NDArray[np.int64]
    defects: NDArray[np.bool_] | None = None


def merge_all(
    record: Record, progress: Progress, targets: Collection[str] | None = None
) -> list[Bracket]:
    """Merge all recorded exposures, or those of the given targets, without the dark frames.

    Gives a bracket for each target, pattern and wavelength.
    """
    sensor = record.camera.sensor
    dark = dark_target(record.plan)
    found = [one for one in find_brackets(record) if targets is None or one.target in targets]
    merged = []
    for number, one in enumerate(found):
        progress.report(number / len(found), f"merging {one.target}, {one.pattern}")
        merged.append(merge_frames(record, one.frames, dark, sensor))
    return merged


@dataclass(frozen=True)
class RecordedBracket(_Frames):
    """Where a record holds a bracket: the indices of its frames; the wavelength was asked for."""

    frames: list[int]


def find_brackets(record: Record) -> list[RecordedBracket]:
    """List what was recorded by target, pattern and wavelength, without dark frames."""
    dark = dark_target(record.plan)
    wavelengths = sorted(set(record.column("wavelength_asked").tolist()))
    return [
        RecordedBracket(target, pattern, wavelength, frames)
        for target in record.target_names
        for pattern in record.pattern_names
        for wavelength in wavelengths
        if target != dark
        and (frames := record.select(target=target, pattern=pattern, wavelength_asked=wavelength))
    ]


def dark_target(plan: PlanFile) -> str:
    """Return the name of the target under which a plan records its dark frames."""
    return plan.reconstruct.dark if plan.reconstruct else "dark"


def merge_frames(record: Record, indices: list[int], dark: str, sensor: Sensor) -> Bracket:
    """Merge frames, each less the mean dark frame of its exposure."""
    first = indices[0]
    bracket = recorded_bracket(record, indices, dark, sensor)
    frames, exposures = np.asarray(bracket.frames), bracket.times
    defects = known_defects(record)
    merged = hdr.merge(bracket, defects=defects)
    state = merged.state.numpy()
    rate, variance = (one.numpy().astype(np.float64) for one in (merged.rate, merged.variance))
    if defects is not None:
        _fill_defects(rate, variance, defects, sensor)
    times = np.unique(exposures).tolist()
    by_exposure = [frames[exposures == t] for t in times]
    # Means of frames have fractions.
    whole = (np.rint(f).astype(np.int64).ravel() for f in by_exposure)
    counts = [0 if math.isinf(count) else int(count) for count in bracket.dark_counts]
    return Bracket(
        target=record.target_names[record.column("target")[first]],
        pattern=record.pattern_names[record.column("pattern")[first]],
        wavelength=float(record.column("wavelength")[first]),
        exposures=times,
        rate=rate,
        variance=variance,
        clipped=float((state == hdr.CLIPPED).mean()),
        dark=float((state == hdr.DARK).mean()),
        clipped_by_exposure=[float((f >= sensor.full_scale).mean()) for f in by_exposure],
        dark_frames=min(counts),
        histogram=np.stack([np.bincount(f, minlength=2**sensor.bits) for f in whole]),
        defects=defects,
    )


def recorded_bracket(record: Record, indices: list[int], dark: str, sensor: Sensor) -> hdr.Bracket:
    """Return the frames of these indices with the mean dark frame of each exposure."""
    exposures = record.column("exposure")[indices]
    darks = {t: _mean_dark(record, dark, t, sensor) for t in sorted(set(exposures.tolist()))}
    return hdr.Bracket(
        np.stack([record.image(i) for i in indices]),
        exposures,
        [darks[t][0] for t in exposures.tolist()],
        # A level from the data sheet has no noise, like the mean of infinitely many frames.
        [float(darks[t][1] or math.inf) for t in exposures.tolist()],
        sensor,
    )


def _mean_dark(record: Record, dark: str, exposure: float, sensor: Sensor) -> tuple[Picture, int]:
    """Return the mean of the dark frames of an exposure, and how many there were.

    Without dark frames of this exposure, the level is computed from the sensor's black level and
    dark current, and the number is 0.
    """
    exposures = record.column("exposure")
    indices = [i for i in record.select(target=dark) if exposures[i] == exposure]
    if not indices:
        level = sensor.black_level + sensor.dark_current * exposure / sensor.gain
        return np.full(sensor.shape, level), 0
    return np.mean([record.image(i) for i in indices], axis=0), len(indices)


def known_defects(record: Record) -> NDArray[np.bool_] | None:
    """Return the defective pixels of a record's camera, (rows, columns).

    None if no calibration of the camera was in force when the frames were taken, or if it lists
    none. Raises UserError if the frames are of another size than the calibration.
    """
    calibration = record.bench.active_camera_calibration
    if calibration is None or not calibration.defects.pixels:
        return None
    mask, shape = calibration.defect_mask(), record.whole_frame
    if mask.shape != shape:
        raise UserError(
            f"{record.path}: its frames are {shape[1]} x {shape[0]} pixels, and its camera was "
            f"calibrated with {mask.shape[1]} x {mask.shape[0]}. Remove the key "
            "'camera_calibration' from the bench file, and take the pictures again."
        )
    return record.readouts[record.chosen_readout].read_mask(mask)


def _fill_defects(
    rate: Picture, variance: Picture, defects: NDArray[np.bool_], sensor: Sensor
) -> None:
    """Fill defective pixels in place from those of the same colour around them.

    The rate, (rows, columns), becomes the median of the others, and the variance their mean squared
    difference from it and their own. Pixels without any other stay.
    """
    pattern = sensor.colour.pattern if sensor.colour else ("M",)
    steps = len(pattern), len(pattern[0])
    for row, column in np.argwhere(defects):
        around = tuple(
            slice(max(n - _REACH * step, n % step), n + _REACH * step + 1, step)
            for n, step in zip((row, column), steps, strict=True)
        )
        sound = ~defects[around] & np.isfinite(variance[around])
        if sound.any():
            others, own = rate[around][sound], variance[around][sound]
            rate[row, column] = np.median(others)
            variance[row, column] = np.mean((others - np.median(others)) ** 2 + own)


def find_bracket(
    brackets: list[Bracket], target: str, pattern: str, wavelength: float | None, path: Path
) -> Bracket:
    """Find the only bracket with this target, pattern and wavelength in metres.

    Without a wavelength, it may have any. Raises UserError, which names the record at `path`, if
    there is no such bracket, or more than one.
    """
    found = [
        bracket
        for bracket in brackets
        if (bracket.target, bracket.pattern) == (target, pattern)
        and (wavelength is None or abs(bracket.wavelength - wavelength) < WAVELENGTH_TOLERANCE)
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
