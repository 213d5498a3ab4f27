"""Tell which calibrations were in force when a record was made, and whether they held then."""

from __future__ import annotations

from datetime import datetime

from drivers.interfaces import Identity
from labapp.bench.calibration_validity import (
    calibration_summary,
    camera_calibration_summary,
    camera_validity_warnings,
    validity_warnings,
)
from labapp.common.errors import UserError
from labapp.runs.brackets.clip_remarks import metered_clip_level
from labapp.runs.record.reader import Record


def calibrations_in_force(record: Record) -> list[str]:
    """Return the calibrations that were in force, a line each."""
    panel, camera = record.bench.active_calibration, record.bench.active_camera_calibration
    return [
        *([calibration_summary(panel)] if panel else []),
        *([camera_calibration_summary(camera)] if camera else []),
    ]


def camera_in_force(record: Record) -> str:
    """Return the calibration of the camera by which light is measured, in a line."""
    camera = record.bench.active_camera_calibration
    if camera is None:
        return "the bench file's description; no calibration of the camera was in force"
    return camera_calibration_summary(camera)


def clip_level_in_force(record: Record) -> str:
    """Return where pixels clip, and who says so, in a line."""
    bench, metered = record.bench_as_opened, metered_clip_level(record.plan)
    number = record.bench.build_camera().sensor.full_scale
    calibration = bench.active_camera_calibration
    if bench.sensor.clip_level_dn is not None:
        source = "by the bench file"
    elif calibration is not None and calibration.clip_number_dn is not None:
        source = "by the calibration of the camera"
    elif bench.tells_clip_level:
        source = "by the bench file, which the simulated camera follows"
    elif metered is not None:
        source = f"seen in metering {metered.target}; the bench file doesn't tell it"
    else:
        source = "the largest number of the bench file's bits, which nothing has confirmed"
    return f"pixels clip at {number} DN: {source}"


def stale_calibrations(record: Record) -> list[str]:
    """Return why calibrations may not have held when the frames were taken.

    Raises UserError for a record that is damaged.
    """
    panel = record.bench.active_calibration
    if panel is None:
        return stale_camera(record)
    found = validity_warnings(panel, record.bench, _identities(record), _start(record))
    return found + stale_camera(record)


def stale_camera(record: Record) -> list[str]:
    """Return why the camera's calibration may not have held when the frames were taken.

    Raises UserError for a record that is damaged.
    """
    camera = record.bench.active_camera_calibration
    if camera is None:
        return []
    return camera_validity_warnings(camera, record.bench, _identities(record), _start(record))


def _start(record: Record) -> datetime:
    text = record.text("start_time")
    try:
        return datetime.fromisoformat(text)
    except ValueError as error:
        raise UserError(
            f"{record.path}: its start time is {text!r}, which is no date. labapp verify says what "
            "is damaged."
        ) from error


def _identities(record: Record) -> dict[str, Identity]:
    return {
        name: Identity(one["model"], one["serial"], one["simulated"])
        for name, one in record.devices.items()
    }
