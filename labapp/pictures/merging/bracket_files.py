"""Read the frames of an exposure bracket from files, and the sensor that took them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import read_bytes
from labapp.files.picture.encoding import Encoding
from labapp.files.picture.opening import count_pages
from labapp.files.picture.photograph import Photograph, read_photograph
from labapp.files.raw import RawPhotograph
from labapp.files.sensor_file import read_sensor
from labapp.pictures.merging.exposure_facts import choose_times
from optics.camera import Sensor

Frame = NDArray[Any]

CODED_SENSOR = Sensor(bits=8, full_well=1e9, dark_current=0.0, black_level=0.0)
"""What is known of the sensor of 8-bit pictures without a word on their noise: the full scale."""

_PILE, _PILE_RATIO = 1e-4, 10.0
"""Share of pixels with the highest number, and their ratio to those with one less, from which on
that number looks like the full scale. Chosen: without clipping, highest numbers are rare."""


@dataclass(frozen=True)
class SensorNumbers:
    """What is said of a sensor on the command line; None for what the sensor file says.

    gain: electrons per digital number. read_noise: electrons. black: digital number of no light.
    full_scale: digital number from which pixels are clipped.
    """

    gain: float | None = None
    read_noise: float | None = None
    black: float | None = None
    full_scale: int | None = None


@dataclass(frozen=True, eq=False)
class BracketFiles:
    """Frames of a bracket from files, each (bands, rows, columns), with times and darks.

    darks: mean dark of each frame, (bands, rows, columns), or a level. dark_counts: frames in each
    mean; infinite for a level. defects: (rows, columns), pixels that don't measure light, or None.
    is_coded: whether frames are 8-bit pictures whose response curve isn't known; of the sensor only
    the full scale is. sensor_source: what the sensor's numbers rest on, in words. doubts: why they
    may not hold. notes: what was done in reading. may_move: whether frames may have moved against
    each other. raw: the first of RAW files, which says what the colours are; None for others.
    """

    names: list[str]
    frames: list[Frame]
    exposures: list[float]
    darks: list[Frame | float]
    dark_counts: list[float]
    sensor: Sensor
    defects: NDArray[np.bool_] | None = None
    is_coded: bool = False
    sensor_source: str = ""
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    may_move: bool = False
    raw: RawPhotograph | None = None

    @property
    def period(self) -> tuple[int, int]:
        """Return the (rows, columns) after which the sensor's colour filters repeat."""
        pattern = None if self.raw is None else self.raw.pattern
        return (1, 1) if pattern is None else (len(pattern), len(pattern[0]))


def read_bracket_files(
    paths: Sequence[Path],
    exposures: Sequence[float] | None,
    darks: Sequence[Path],
    sensor_file: Path | None,
    numbers: SensorNumbers,
    encoding: Encoding | None,
) -> BracketFiles:
    """Read frames and darks from files, or from the pages of one.

    exposures: seconds; None for those that the files tell. Raises UserError for files that don't
    fit together, and for a sensor of which too little is known.
    """
    photographs, names = _read_frames(paths, encoding)
    require_times(exposures, len(names), "files" if len(paths) == len(names) else "pages")
    _require_one_kind(photographs)
    told = sensor_file is not None or numbers != SensorNumbers() or darks or encoding is not None
    # Coded levels of 8 bits are of a response curve, a camera's own.
    is_coded = not told and all(
        one.is_coded and one.levels.dtype == np.uint8 for one in photographs
    )
    times, notes, doubts = choose_times(photographs, exposures, is_coded)
    first = photographs[0]
    if not is_coded:
        notes.append(f"numbers are {first.encoding.name}: {first.encoding_source}")
    notes += dict.fromkeys(note for one in photographs for note in one.remarks)
    frames = [one.levels if is_coded else _numbers(one) for one in photographs]
    for name, frame in zip(names, frames, strict=True):
        if frame.shape != frames[0].shape:
            raise UserError(
                f"{name}: is {_size(frame)} and {names[0]} is {_size(frames[0])}. All frames of a "
                "bracket have one size."
            )
    if is_coded:
        levels: list[Frame | float] = [0.0] * len(frames)
        return BracketFiles(
            names, frames, times, levels, [math.inf] * len(frames), CODED_SENSOR, is_coded=True,
            doubts=tuple(doubts), notes=tuple(notes), may_move=True,
        )  # fmt: skip
    bits = 16
    if not first.is_coded and first.white is not None:
        bits = min(16, int(first.white).bit_length())
    sensor = build_sensor(sensor_file, numbers, bits, frames[0].shape[1:])
    means, counts = _mean_darks(darks, frames[0], len(frames), sensor, encoding)
    return BracketFiles(
        names, frames, times, means, counts, sensor,
        sensor_source=sensor_source(sensor_file, numbers),
        doubts=(*doubts, *equal_times(times), *other_full_scale(frames, times, sensor)),
        notes=tuple(notes), may_move=True,
    )  # fmt: skip


def _read_frames(
    paths: Sequence[Path], encoding: Encoding | None
) -> tuple[list[Photograph], list[str]]:
    """Read photographs, and return them with their names.

    The pages of a single TIFF are frames, in their order. Raises UserError for files of which one
    has several pages.
    """
    counts = [
        count_pages(path, read_bytes(path)) if path.suffix.lower() in (".tif", ".tiff") else 1
        for path in paths
    ]
    if len(paths) == 1 and counts[0] > 1:
        (path,) = paths
        pages = range(counts[0])
        return (
            [read_photograph(path, encoding=encoding, page=page) for page in pages],
            [f"{path.name}, page {page + 1}" for page in pages],
        )
    for path, count in zip(paths, counts, strict=True):
        if count > 1:
            raise UserError(
                f"{path}: has {count} pages. Give a TIFF whose pages are the frames by itself, or "
                "files of one picture each."
            )
    return [read_photograph(one, encoding=encoding) for one in paths], [one.name for one in paths]


def require_times(exposures: Sequence[float] | None, count: int, kind: str) -> None:
    """Raise UserError unless there is a time for each frame, if any is told."""
    if exposures is not None and len(exposures) != count:
        raise UserError(
            f"--exposures has {len(exposures)} times for {count} {kind}. Give one for each, in "
            "their order, as in --exposures 0.001,0.004,0.016."
        )


def equal_times(times: Sequence[float]) -> list[str]:
    """Say in words if all frames have one exposure time."""
    if len(times) == 1 or len(set(times)) > 1:
        return []
    return [
        f"all exposures are {times[0]:g} s: the light is their mean, over the range of one "
        "exposure. Take different times for a wider range, and check --exposures"
    ]


def other_full_scale(
    frames: Sequence[Frame],
    times: Sequence[float],
    sensor: Sensor,
    remedy: str = "Give --full-scale",
) -> list[str]:
    """Say in words if the frames' numbers end below the sensor's full scale.

    remedy: what to do; the number follows.
    """
    longest = frames[int(np.argmax(times))]
    top = float(longest.max())
    if top >= sensor.full_scale:
        return []
    count, below = (int((longest == number).sum()) for number in (top, top - 1))
    if count < _PILE * longest.size or count < _PILE_RATIO * below:
        return []
    return [
        f"{count} pixels of the longest exposure have the number {top:g}, which none exceeds, and "
        f"the full scale is taken to be {sensor.full_scale}: if the sensor's is {top:g}, clipped "
        f"pixels weren't known. {remedy} {top:g}"
    ]


def sensor_source(path: Path | None, numbers: SensorNumbers) -> str:
    """Say in words what the numbers of a sensor rest on."""
    given = (
        ("--gain", numbers.gain), ("--read-noise", numbers.read_noise), ("--black", numbers.black),
        ("--full-scale", numbers.full_scale),
    )  # fmt: skip
    options = [name for name, value in given if value is not None]
    named = [] if path is None else [f"the sensor file {path.name}"]
    return ", ".join([*named, *options])


def _require_one_kind(photographs: Sequence[Photograph]) -> None:
    """Raise UserError if photographs hold numbers of different kinds."""
    first = photographs[0]
    for one in photographs:
        if one.levels.dtype != first.levels.dtype:
            raise UserError(
                f"{one.path}: has {one.levels.dtype} numbers and {first.path} {first.levels.dtype} "
                "ones. Give frames of one kind, as the sensor made them."
            )
        if one.encoding.name != first.encoding.name:
            raise UserError(
                f"{one.path}: is {one.encoding.name} ({one.encoding_source}) and {first.path} "
                f"{first.encoding.name} ({first.encoding_source}). Give frames of one kind, or "
                "name the encoding of all: --encoding."
            )


def _numbers(photograph: Photograph) -> Frame:
    """Return numbers proportional to light; sRGB levels become 16-bit ones."""
    if photograph.is_coded:
        return np.asarray(np.rint(photograph.light * 65535).astype(np.uint16))
    levels = photograph.levels
    if levels.dtype.kind == "f" and not np.isfinite(levels).all():
        raise UserError(
            f"{photograph.path}: has numbers that are NaN or infinite. Give the frame as the "
            "sensor made it."
        )
    if levels.dtype.kind == "f" and levels.max() <= 1:
        raise UserError(
            f"{photograph.path}: has numbers up to {levels.max():g}. Give the sensor's digital "
            "numbers, not shares of them."
        )
    return np.asarray(levels)


def _size(frame: Frame) -> str:
    bands, rows, columns = frame.shape
    return f"{columns} x {rows} pixels" + (f" in {bands} colours" if bands > 1 else "")


def build_sensor(
    path: Path | None, numbers: SensorNumbers, bits: int, shape: tuple[int, ...]
) -> Sensor:
    """Return the sensor of its own file, or of the numbers that are given.

    bits: of the frames' numbers. Raises UserError if too little is known.
    """
    if path is not None:
        known = read_sensor(path.name, path.parent).build()
    else:
        if numbers.gain is None or numbers.read_noise is None:
            raise UserError(
                "the noise of the sensor isn't known: give --sensor FILE, or --gain (electrons per "
                "digital number) and --read-noise (electrons). labapp calibrate --camera "
                "measures them."
            )
        # The well of a sensor that these describe never fills first.
        known = replace(CODED_SENSOR, bits=bits)
    told = {
        "gain": numbers.gain, "read_noise": numbers.read_noise, "black_level": numbers.black,
    }  # fmt: skip
    changes: dict[str, Any] = {name: value for name, value in told.items() if value is not None}
    rows, columns = shape
    try:
        known = replace(known, shape=(rows, columns), colour=None, **changes)
        if numbers.full_scale is not None:
            # The full scale follows from the well.
            well = (numbers.full_scale - known.black_level + 0.5) * known.gain
            known = replace(known, full_well=well + 5 * known.read_noise)
    except ValueError as error:
        raise UserError(f"the sensor's numbers can't be: {error}.") from error
    return known


def _mean_darks(
    paths: Sequence[Path], frame: Frame, count: int, sensor: Sensor, encoding: Encoding | None
) -> tuple[list[Frame | float], list[float]]:
    """Return the mean dark of each frame, and how many darks are in it."""
    if not paths:
        return [sensor.black_level] * count, [float("inf")] * count
    darks = [_numbers(read_photograph(path, encoding=encoding)) for path in paths]
    for path, dark in zip(paths, darks, strict=True):
        if dark.shape != frame.shape:
            raise UserError(f"{path}: is {_size(dark)} and the frames {_size(frame)}.")
    means, counts = group_darks(darks, count)
    return list(means), counts


def group_darks(darks: Sequence[Frame], count: int) -> tuple[list[Frame], list[float]]:
    """Average darks for each frame, and return how many are in each mean.

    Of as many for each frame, each has its own, in their order; otherwise all have all.
    """
    each, rest = divmod(len(darks), count)
    if each and not rest:
        groups = [darks[number * each : (number + 1) * each] for number in range(count)]
    else:
        groups = [darks] * count
    stacks = map(np.stack, groups)
    means = [np.asarray(one.mean(axis=0, dtype=np.float64), np.float32) for one in stacks]
    return means, [float(len(group)) for group in groups]
