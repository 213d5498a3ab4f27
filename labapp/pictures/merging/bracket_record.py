"""Take the frames of an exposure bracket from the record of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.pictures.analysis.brackets import (
    WAVELENGTH_TOLERANCE,
    RecordedBracket,
    dark_target,
    find_brackets,
    known_defects,
    recorded_bracket,
)
from labapp.pictures.merging.bracket_files import BracketFiles, other_full_scale
from labapp.runs.record.reader import Record
from labapp.runs.recorded_calibrations import camera_in_force, clip_level_in_force, stale_camera

_REMEDY = "Before the next run, write in [sensor] of the bench file: clip_level_dn ="


@dataclass(frozen=True)
class RecordedFrames:
    """Which frames of a record are merged; None for the only ones there are.

    target, pattern: names in the plan. wavelength: metres. readout: number of a way of reading the
    sensor.
    """

    target: str | None = None
    pattern: str | None = None
    wavelength: float | None = None
    readout: int | None = None


def read_recorded_bracket(path: Path, wanted: RecordedFrames) -> BracketFiles:
    """Read the frames of one target with one pattern at one wavelength from a record.

    Raises UserError, with all brackets of the record, if none fits or several do.
    """
    with Record(path, readout=wanted.readout) as record:
        every = find_brackets(record)
        found = [one for one in every if _fits(one, wanted)]
        if len(found) != 1:
            which = "several brackets fit" if found else "no bracket fits"
            listed = "; ".join(one.name for one in (found or every)[:12])
            raise UserError(
                f"{path}: {which}. Choose by --target, --pattern and --wavelength-nm: {listed}."
            )
        frames, sensor = found[0].frames, record.camera.sensor
        bracket = recorded_bracket(record, frames, dark_target(record.plan), sensor)
        defects = known_defects(record)
        source = f"{camera_in_force(record)}; {clip_level_in_force(record)}"
        times = bracket.times.tolist()
        piled = other_full_scale(list(bracket.frames), times, sensor, _REMEDY)
        doubts = (*stale_camera(record), *piled)
    return BracketFiles(
        [f"frame {index}" for index in frames],
        [np.asarray(frame)[None] for frame in bracket.frames],
        times,
        [np.asarray(one)[None] for one in bracket.darks],
        bracket.dark_counts.tolist(),
        sensor,
        defects,
        sensor_source=source,
        doubts=doubts,
    )


def _fits(one: RecordedBracket, wanted: RecordedFrames) -> bool:
    return (
        wanted.target in (None, one.target)
        and wanted.pattern in (None, one.pattern)
        and (
            wanted.wavelength is None
            or abs(wanted.wavelength - one.wavelength) < WAVELENGTH_TOLERANCE
        )
    )
