"""Checks of wanted bands against those that were recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from labapp.common.errors import UserError
from labapp.files.wavelengths import list_nanometres
from labapp.pictures.analysis.brackets import WAVELENGTH_TOLERANCE
from labapp.runs.record.reader import Record


def recorded_wavelengths(record: Record, target: str, pattern: str) -> tuple[float, ...]:
    """Return the wavelengths in metres at which a target was recorded with a pattern, rising."""
    frames = record.select(target=target, pattern=pattern)
    return tuple(np.unique(record.column("wavelength")[frames]).tolist())


def require_recorded_bands(
    wanted: Sequence[float], recorded: Sequence[float], what: str, record: Record
) -> tuple[float, ...]:
    """Return the recorded wavelengths of wanted bands; raise UserError if one is missing.

    Both are in metres. `what` says in words what was recorded, and the error names the range of the
    record's filter.
    """
    found = []
    for one in wanted:
        at = [own for own in recorded if abs(own - one) < WAVELENGTH_TOLERANCE]
        if not at:
            has = list_nanometres(recorded) if recorded else "no wavelength"
            raise UserError(
                f"--bands {one * 1e9:g}: {record.path} has {what} at {has}"
                f"{_filter_range(record, one)}. Choose among these, or run a plan with that band."
            )
        found.append(at[0])
    return tuple(found)


def require_single_slots(record: Record, target: str, pattern: str) -> None:
    """Raise UserError if frames of one wavelength came through different filter slots.

    Two slots with the same centre, one open and one narrow, would be merged into one picture.
    """
    frames = record.select(target=target, pattern=pattern)
    wavelengths, slots = (record.column(name)[frames] for name in ("wavelength", "slot"))
    for one in np.unique(wavelengths):
        through = np.unique(slots[wavelengths == one]).tolist()
        if len(through) > 1:
            raise UserError(
                f"{record.path}: has {target!r} at {one * 1e9:g} nm through the slots "
                f"{' and '.join(map(str, through))}. In the bench file, give the open slot a "
                "centre of its own."
            )


def sensor_pitch(record: Record) -> float:
    """Return the sensor's pitch in metres."""
    return record.camera.sensor.pitch


def _filter_range(record: Record, wavelength: float) -> str:
    """Say what the filter can be tuned to, if a wavelength (metres) lies outside; else nothing."""
    table = record.bench.devices.tables.get("filter")
    span = None if table is None else dict(table.options).get("range_nm")
    if span is None or span[0] <= wavelength * 1e9 <= span[1]:
        return ""
    return f"; the filter can be tuned from {span[0]:g} to {span[1]:g} nm only"
