"""All steps on one bench: trial exposures, plan, run, fits and files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labapp.bench.opening import Bench
from labapp.bench.star_target import require_star_target
from labapp.calibration import plan_design
from labapp.calibration.calibration_tables import build_calibration_file
from labapp.calibration.exposure_search import (
    StarExposure,
    TrialFrame,
    derive_exposures,
    evaluate_trials,
    first_bracket,
    nominal_star_width,
)
from labapp.calibration.fitting import CalibrationFits, fit_calibration
from labapp.calibration.request import NEUTRAL_NAME, CalibrationExposures, CalibrationRequest
from labapp.calibration.trial_exposures import trial_plan
from labapp.common.errors import UserError
from labapp.files.calibration_file import CalibrationFile, calibration_to_json
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PATTERN_FOLDER, PLAN_FILE, RECORD_FILE, write_plan
from labapp.files.writing import make_folder, require_free_names, write_atomically
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.runner import RunOutcome, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import require_complete, run_written_plan
from optics.camera import Camera
from optics.progress import Progress

CALIBRATION_FILE, PICTURE_FILE = "calibration.json", "calibration.png"

_MOST_TRIALS = 4
"""Most rounds of trial exposures at a wavelength; chosen."""

_TRIAL_SHARE, _RUN_SHARE = 0.1, 0.8
"""Shares of the progress that are reached after the trials and after the run."""


@dataclass(frozen=True)
class CalibrationResult:
    """The fits, and the content of their file."""

    fits: CalibrationFits
    file: CalibrationFile


def calibrate(
    bench: Bench,
    request: CalibrationRequest,
    folder: Path,
    *,
    force: bool = False,
    progress: Progress | None = None,
    ask: AskOperator | None = None,
) -> CalibrationResult:
    """Find the exposure on a bench, take all frames, fit them, and write the files.

    The folder gets plan.toml, patterns/, run.h5, calibration.json and calibration.png. Raises a
    UserError that says what is wrong at the bench, and Cancelled if the progress was cancelled.
    """
    progress = progress or Progress()
    require_free_names(
        folder, (PLAN_FILE, RECORD_FILE, CALIBRATION_FILE, PICTURE_FILE), force=force
    )
    request = complete_request(request, bench)
    make_folder(folder)
    # The bench's calibration is used if it has one, because it improves the gratings.
    camera = bench.description
    exposures = []
    count = len(request.wavelengths_nm)
    for number, nm in enumerate(request.wavelengths_nm):
        part = progress.part(_TRIAL_SHARE * number / count, _TRIAL_SHARE * (number + 1) / count)
        exposures.append(_find_exposures(bench, camera, request, nm, folder, part, ask))
    plan = write_calibration_plan(camera, request, tuple(exposures), folder)
    run_written_plan(
        bench, plan, folder, force=force, progress=progress.part(_TRIAL_SHARE, _RUN_SHARE), ask=ask
    )
    return fit_and_write(folder / RECORD_FILE, progress.part(_RUN_SHARE, 1.0))


def write_calibration_plan(
    camera: Camera,
    request: CalibrationRequest,
    exposures: tuple[CalibrationExposures, ...],
    folder: Path,
) -> PlanFile:
    """Design plan and patterns, and write them to a folder."""
    made = plan_design.design_calibration(camera, request, exposures)
    shown = plan_design.render_patterns(camera, made)
    plan = plan_design.build_plan(made, shown, PATTERN_FOLDER)
    write_plan(folder, plan, shown)
    return plan


def prepare_plan_only(
    bench: Bench, request: CalibrationRequest, folder: Path, *, force: bool = False
) -> PlanFile:
    """Write plan and patterns for a later run; UserError without an exposure."""
    require_free_names(folder, (PLAN_FILE,), force=force)
    if request.exposure_ms is None:
        raise UserError(
            "--plan-only takes no pictures, and can't find the exposure by trial. Give "
            "--exposure-ms: of the neutral star, a little below clipping."
        )
    request = complete_request(request, bench)
    make_folder(folder)
    camera = bench.description
    exposures = [_requested_exposures(camera, request, nm) for nm in request.wavelengths_nm]
    return write_calibration_plan(camera, request, tuple(exposures), folder)


def fit_and_write(record: Path, progress: Progress | None = None) -> CalibrationResult:
    """Fit a record, and write calibration.json and calibration.png beside it."""
    from labapp.calibration.overview_figure import draw_overview
    from labapp.common.figure_png import figure_to_png

    progress = progress or Progress()
    fits = fit_calibration(record, progress.part(0.0, 0.9))
    file = build_calibration_file(fits)
    progress.report(0.9, "picture")
    write_atomically(record.with_name(CALIBRATION_FILE), calibration_to_json(file))
    write_atomically(record.with_name(PICTURE_FILE), figure_to_png(draw_overview(fits, file)))
    progress.report(1.0, "calibrated")
    return CalibrationResult(fits, file)


def complete_request(request: CalibrationRequest, bench: Bench) -> CalibrationRequest:
    """Add the star's size and distance as the bench's scene has them.

    Raises UserError if the bench lacks the star or the dark target, or if the wavefront is
    requested and the star's size or distance isn't known.
    """
    table = require_star_target(bench, request.star, request.dark)
    known: dict[str, float] = {}
    if table is not None:
        known = {"star_diameter_um": table.diameter_um, "star_distance_m": table.distance_m}
    given = {key: value for key, value in request.model_dump().items() if value is not None}
    filled = CalibrationRequest.model_validate(known | given)
    if filled.includes("wavefront") and None in (filled.star_diameter_um, filled.star_distance_m):
        raise UserError(
            "the wavefront is judged by the star's picture: give its size and distance with "
            "--star-um and --star-m, or leave the wavefront out with --only."
        )
    return filled


def _requested_exposures(
    camera: Camera, request: CalibrationRequest, nm: float
) -> CalibrationExposures:
    assert request.exposure_ms is not None
    found = StarExposure(request.exposure_ms * 1e-3, nominal_star_width(camera, nm))
    return derive_exposures(camera, request, nm, found, 0)


def _find_exposures(
    bench: Bench,
    camera: Camera,
    request: CalibrationRequest,
    nm: float,
    folder: Path,
    progress: Progress,
    ask: AskOperator | None,
) -> CalibrationExposures:
    """Find the exposures at one wavelength by trial, unless the request gives one."""
    if request.exposure_ms is not None:
        return _requested_exposures(camera, request, nm)
    trials: list[TrialFrame] = []
    wanted = first_bracket(camera)
    for number in range(_MOST_TRIALS):
        path = folder / f"trial-{nm:g}-{number + 1}.h5"
        part = progress.part(number / _MOST_TRIALS, (number + 1) / _MOST_TRIALS)
        title = f"Trial of the exposure, {nm:g} nm"
        plan = trial_plan(title, NEUTRAL_NAME, {(request.star, nm): wanted})
        outcome = run_plan(
            bench, plan, path, Attendance(progress=part, ask=ask), source="trial", force=True
        )
        require_complete(outcome)
        trials += _trials(outcome)
        answer = evaluate_trials(trials, camera)
        if isinstance(answer, StarExposure):
            progress.report(1.0, f"exposure, {nm:g} nm")
            return derive_exposures(camera, request, nm, answer, len(trials))
        wanted = answer
    tried = ", ".join(f"{trial.exposure * 1e3:g}" for trial in trials)
    raise UserError(
        f"no exposure of the neutral star is right at {nm:g} nm; tried {tried} ms. Check that the "
        "lamp is steady, or give --exposure-ms."
    )


def _trials(outcome: RunOutcome) -> list[TrialFrame]:
    with Record(outcome.path) as record:
        exposures = record.column("exposure")
        return [
            TrialFrame(float(exposures[index]), np.asarray(record.image(index)))
            for index in range(record.frame_count)
        ]
