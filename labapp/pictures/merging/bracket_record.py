"""Take the frames of an exposure bracket from the record of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.pictures.analysis.brackets import (
    WAVELENGTH_TOLERANCE,
    dark_target,
    recorded_bracket,
)
from labapp.pictures.merging.bracket_files import BracketFiles
from labapp.runs.record.reader import Record


@dataclass(frozen=True)
class RecordedFrames:
    """Which frames of a record are merged; None for the only ones there are.

    target, pattern: names in the plan. wavelength: metres.
    """

    target: str | None = None
    pattern: str | None = None
    wavelength: float | None = None


def read_recorded_bracket(path: Path, wanted: RecordedFrames) -> BracketFiles:
    """Read the bracket of one target with one pattern at one wavelength from a record.

    Raises UserError, with all brackets of the record, if none fits or several do.
    """
    with Record(path) as record:
        dark = dark_target(record.plan)
        every = _brackets(record, dark)
        found = [one for one in every if _fits(one, wanted)]
        if len(found) != 1:
            which = "several brackets fit" if found else "no bracket fits"
            listed = "; ".join(_describe(one) for one in (found or every)[:12])
            raise UserError(
                f"{path}: {which}. Choose by --target, --pattern and --wavelength-nm: {listed}."
            )
        target, pattern, asked = found[0]
        indices = record.select(target=target, pattern=pattern, wavelength_asked=asked)
        sensor = record.bench.build_camera().sensor
        bracket = recorded_bracket(record, indices, dark, sensor)
    return BracketFiles(
        [f"frame {index}" for index in indices],
        [np.asarray(frame)[None] for frame in bracket.frames],
        bracket.times.tolist(),
        [np.asarray(one)[None] for one in bracket.darks],
        bracket.dark_counts.tolist(),
        sensor,
    )


def _brackets(record: Record, dark: str) -> list[tuple[str, str, float]]:
    """Return (target, pattern, wavelength that was asked for) of a record's brackets."""
    wavelengths = sorted(set(record.column("wavelength_asked").tolist()))
    return [
        (target, pattern, wavelength)
        for target in record.target_names
        for pattern in record.pattern_names
        for wavelength in wavelengths
        if target != dark
        and record.select(target=target, pattern=pattern, wavelength_asked=wavelength)
    ]


def _fits(one: tuple[str, str, float], wanted: RecordedFrames) -> bool:
    target, pattern, wavelength = one
    return (
        wanted.target in (None, target)
        and wanted.pattern in (None, pattern)
        and (
            wanted.wavelength is None or abs(wanted.wavelength - wavelength) < WAVELENGTH_TOLERANCE
        )
    )


def _describe(one: tuple[str, str, float]) -> str:
    target, pattern, wavelength = one
    return f"{target}, {pattern}, {wavelength * 1e9:g} nm"
