"""All steps for a bench's camera: trial exposures, plan, run, fit and files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

import labapp
from labapp.bench.opening import Bench
from labapp.calibration.camera.exposure_search import find_longest_exposure
from labapp.calibration.camera.plan_design import CameraRequest, build_camera_plan
from labapp.calibration.camera.recorded_frames import RecordedPairs, read_pairs
from labapp.common.errors import UserError
from labapp.files.calibration_file import DeviceIdentityTable, calibration_to_json
from labapp.files.camera_noise_file import (
    CameraNoiseFile,
    CurvePointTable,
    DefectTable,
    QuantityTable,
)
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import RECORD_FILE, write_plan
from labapp.files.writing import make_folder, write_atomically
from labapp.runs.acquisition.attendance import AskOperator
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import run_written_plan
from optics.measuring import CameraNoise, Measured, characterise_camera
from optics.measuring.pixel_maps import DEAD_RESPONSE, RESPONSE_EXCESS
from optics.progress import Progress

CAMERA_FILE, PICTURE_FILE = "camera.json", "camera.png"

_TRIAL_SHARE, _RUN_SHARE = 0.1, 0.7
"""Shares of the progress that are reached after the trials and after the run."""

_DECIBELS = 20 / math.log(10)
"""Decibels in a natural logarithm of a ratio of amplitudes."""

_DIGITS = 3
"""Digits that are written of an uncertainty; the quantity has as many decimals."""


@dataclass(frozen=True, eq=False)
class CameraResult:
    """The fit, and the content of its file."""

    noise: CameraNoise
    file: CameraNoiseFile


def calibrate_camera(
    bench: Bench,
    request: CameraRequest,
    folder: Path,
    *,
    force: bool = False,
    progress: Progress | None = None,
    ask: AskOperator | None = None,
) -> CameraResult:
    """Find the exposures, take all frames, fit them, and write the files.

    The folder gets plan.toml, run.h5, camera.json and camera.png. Raises a UserError that says what
    is wrong at the bench, and Cancelled if the progress was cancelled.
    """
    progress = progress or Progress()
    _require_targets(bench, request)
    make_folder(folder)
    if request.flat_ms is None:
        part = progress.part(0, _TRIAL_SHARE)
        longest, trials = find_longest_exposure(bench, request, folder, part, ask)
        request = request.model_copy(update={"flat_ms": longest * 1e3, "trials": trials})
    plan = _write_plan(bench, request, folder)
    run_written_plan(
        bench, plan, folder, force=force, progress=progress.part(_TRIAL_SHARE, _RUN_SHARE), ask=ask
    )
    return fit_camera_and_write(folder / RECORD_FILE, progress=progress.part(_RUN_SHARE, 1.0))


def prepare_camera_plan(bench: Bench, request: CameraRequest, folder: Path) -> PlanFile:
    """Write the plan for a later run; UserError without an exposure."""
    _require_targets(bench, request)
    if request.flat_ms is None:
        raise UserError(
            "--plan-only takes no pictures, and can't find the exposure by trial. Give --flat-ms: "
            "of the flat target, a quarter more than fills the pixels."
        )
    make_folder(folder)
    return _write_plan(bench, request, folder)


def fit_camera_and_write(
    path: Path, flat: str | None = None, progress: Progress | None = None
) -> CameraResult:
    """Fit a record, and write camera.json and camera.png beside it.

    flat: name of the flat target, where the record has several. Raises UserError for frames from
    which a camera's noise doesn't follow.
    """
    from labapp.calibration.camera.overview_figure import draw_camera
    from labapp.common.figure_png import figure_to_png

    progress = progress or Progress()
    with Record(path) as record:
        pairs = read_pairs(record, flat)
        progress.report(0.1, "photon transfer")
        try:
            noise = characterise_camera(pairs.frames)
        except ValueError as error:
            raise UserError(f"{path}: {error}.") from error
        file = build_noise_file(record, pairs, noise)
    progress.report(0.8, "picture")
    write_atomically(path.with_name(CAMERA_FILE), calibration_to_json(file))
    write_atomically(path.with_name(PICTURE_FILE), figure_to_png(draw_camera(noise, file)))
    progress.report(1.0, "calibrated")
    return CameraResult(noise, file)


def _write_plan(bench: Bench, request: CameraRequest, folder: Path) -> PlanFile:
    plan = build_camera_plan(request, bench.description.sensor)
    write_plan(folder, plan, {})
    return plan


def _require_targets(bench: Bench, request: CameraRequest) -> None:
    """Raise UserError if the bench lacks the flat or the dark target."""
    names = bench.targets.names
    for option, name in (("flat", request.flat), ("dark", request.dark)):
        if name not in names:
            meant = "evenly lit" if option == "flat" else "without light"
            raise UserError(
                f"--{option} {name!r}: this bench has no such target. Name the one that is "
                f"{meant}, among {', '.join(names)}."
            )
    if request.flat == request.dark:
        raise UserError(f"--flat and --dark are both {request.flat!r}. Name two targets.")


def build_noise_file(record: Record, pairs: RecordedPairs, noise: CameraNoise) -> CameraNoiseFile:
    """Build the file's content; date, camera and bench come from the run's record."""
    bench = record.bench
    light = list(pairs.frames.light)
    linearity = noise.linearity
    drift = linearity.drift if linearity else None
    return CameraNoiseFile(
        version=1,
        kind="camera noise",
        date=datetime.fromisoformat(record.text("start_time")),
        bench=bench.name,
        record=record.path.name,
        frames=noise.frames + pairs.request.trials,
        software=f"labapp {labapp.__version__}",
        camera=DeviceIdentityTable(**record.devices["camera"]),
        options=bench.devices.camera.options,
        sensor=bench.sensor.model_dump(mode="json"),
        wavelength_nm=pairs.wavelength * 1e9,
        exposures_ms=(min(light) * 1e3, max(light) * 1e3),
        gain_electrons_per_dn=_table(noise.gain),
        system_gain_dn_per_electron=_table(noise.system_gain),
        read_noise_electrons=_table(noise.read_noise),
        read_noise_is_limit=noise.read_noise_is_limit,
        dark_noise_dn=_table(noise.dark_noise),
        black_level_dn=_table(noise.black_level),
        dark_current_electrons_per_s=_table(noise.dark_current),
        full_well_electrons=_optional(noise.full_well),
        clip_number_dn=_optional(noise.clip_number),
        clip_limit=noise.clip_limit,
        saturation_capacity_electrons=_optional(noise.saturation_capacity),
        sensitivity_threshold_electrons=_table(noise.sensitivity_threshold),
        dynamic_range_db=_optional(_decibels(noise.dynamic_range)),
        snr_max_db=_optional(_decibels(noise.snr_max)),
        linearity_error_percent=_optional(linearity.error * 100 if linearity else None),
        lamp_drift_percent=_optional(drift * 100 if drift else None),
        prnu_percent=_optional(noise.prnu * 100 if noise.prnu else None),
        dsnu_electrons=_table(noise.dsnu),
        reduced_chi2=noise.transfer.chi2,
        degrees_of_freedom=noise.transfer.freedom,
        light_unevenness_percent=round(100 * noise.unevenness, 3),
        lamp_jump_percent=round(100 * noise.lamp_jump, 4),
        defects=_defect_table(noise),
        curve=_curve(noise),
    )


def _table(one: Measured) -> QuantityTable:
    """Round a quantity to the digits that its uncertainty has."""
    if not one.sigma > 0:
        return QuantityTable(value=one.value, sigma=0.0)
    decimals = _DIGITS - 1 - math.floor(math.log10(one.sigma))
    return QuantityTable(value=round(one.value, decimals), sigma=round(one.sigma, decimals))


def _optional(one: Measured | None) -> QuantityTable | None:
    return None if one is None else _table(one)


def _decibels(one: Measured | None) -> Measured | None:
    """Convert a ratio of amplitudes to decibels, 20 log10 of it."""
    if one is None:
        return None
    return Measured(_DECIBELS * math.log(one.value), _DECIBELS * one.sigma / one.value)


def _defect_table(noise: CameraNoise) -> DefectTable:
    """Return the defective pixels with the criteria that found them."""
    found, gain = noise.defects, noise.gain.value
    return DefectTable(
        hot=_pixels(found.hot),
        bright=_pixels(found.bright),
        weak=_pixels(found.weak),
        dead=_pixels(found.dead),
        hot_electrons=round(found.dark_limit * gain, 3),
        hot_electrons_per_s=round(found.current_limit * gain, 3),
        response_percent=100 * RESPONSE_EXCESS,
        dead_percent=100 * DEAD_RESPONSE,
    )


def _pixels(found: np.ndarray) -> tuple[tuple[int, int], ...]:
    return tuple((int(row), int(column)) for row, column in found)


def _curve(noise: CameraNoise) -> tuple[CurvePointTable, ...]:
    """Return the photon transfer curve with one point for each exposure time."""
    transfer, points = noise.transfer, []
    for time in np.unique(transfer.exposure):
        same = transfer.exposure == time
        points.append(
            CurvePointTable(
                exposure_ms=float(time) * 1e3,
                signal_dn=round(float(transfer.signal[same].mean()), 4),
                variance_dn2=round(float(transfer.variance[same].mean()), 4),
                fitted=bool(transfer.used[same].all()),
            )
        )
    return tuple(points)
