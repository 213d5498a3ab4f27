"""A calibration from trial to file: plans, runs and fits, on one bench."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labapp.bench.opening import Bench
from labapp.bench.star import known_star
from labapp.calibration import designing
from labapp.calibration.exposing import (
    Found,
    Trial,
    exposures_of,
    first_bracket,
    judged,
    nominal_width,
    trial_plan,
)
from labapp.calibration.filing import calibration_of
from labapp.calibration.fitting import Fits, fit_record
from labapp.calibration.request import Exposures, Request
from labapp.common.errors import UserError
from labapp.files.calibration_file import CalibrationFile, as_json
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PICTURES, write_plan
from labapp.files.writing import make_folder, require_free, write_whole
from labapp.runs.acquisition.runner import Outcome, run_plan
from labapp.runs.acquisition.taking import Ask
from labapp.runs.record.reader import Record
from labapp.runs.running import require_complete
from optics.camera import Camera
from optics.progress import Progress

PLAN, RECORD, FILE, PICTURE = "plan.toml", "run.h5", "calibration.json", "calibration.png"

_MOST_TRIALS = 4
"""Rounds of trial exposures at a wavelength."""

_TRIAL_SHARE, _RUN_SHARE = 0.1, 0.8
"""Of a calibration's progress, from its beginning to the end of the trials and of the run."""


@dataclass(frozen=True)
class Calibrated:
    """What a calibration left: its fits, and the file's content."""

    fits: Fits
    file: CalibrationFile


def calibrate(
    bench: Bench,
    request: Request,
    folder: Path,
    *,
    force: bool = False,
    progress: Progress | None = None,
    ask: Ask | None = None,
) -> Calibrated:
    """Find the exposure, take every frame, fit, and write all of it to a folder.

    The folder gets plan.toml, patterns/, run.h5, calibration.json and calibration.png.
    UserError says what is wrong at the bench; Cancelled if the progress was cancelled.
    """
    progress = progress or Progress()
    require_free(folder, (PLAN, RECORD, FILE, PICTURE), force=force)
    request = completed(request, bench)
    make_folder(folder)
    # As well calibrated as it is: the steadier the gratings.
    camera = bench.description
    exposures = []
    count = len(request.wavelengths_nm)
    for number, nm in enumerate(request.wavelengths_nm):
        part = progress.part(_TRIAL_SHARE * number / count, _TRIAL_SHARE * (number + 1) / count)
        exposures.append(_exposures(bench, camera, request, nm, folder, part, ask))
    plan = prepare(camera, request, tuple(exposures), folder)
    outcome = run_plan(
        bench,
        plan,
        folder / RECORD,
        source=str(folder / PLAN),
        folder=folder,
        force=force,
        progress=progress.part(_TRIAL_SHARE, _RUN_SHARE),
        ask=ask,
    )
    require_complete(outcome)
    return conclude(folder / RECORD, progress.part(_RUN_SHARE, 1.0))


def prepare(
    camera: Camera, request: Request, exposures: tuple[Exposures, ...], folder: Path
) -> PlanFile:
    """Design, and write plan and pictures to a folder."""
    made = designing.design(camera, request, exposures)
    shown = designing.patterns(camera, made)
    plan = designing.plan_of(made, shown, PICTURES)
    write_plan(folder, plan, shown)
    return plan


def prepare_only(bench: Bench, request: Request, folder: Path, *, force: bool = False) -> PlanFile:
    """Plan and pictures for a run later on; UserError without an exposure."""
    require_free(folder, (PLAN,), force=force)
    if request.exposure_ms is None:
        raise UserError(
            "--plan-only takes no pictures, and can't find the exposure by trial. Give "
            "--exposure-ms: of the neutral star, a little below clipping."
        )
    request = completed(request, bench)
    make_folder(folder)
    camera = bench.description
    exposures = [_given(camera, request, nm) for nm in request.wavelengths_nm]
    return prepare(camera, request, tuple(exposures), folder)


def conclude(record: Path, progress: Progress | None = None) -> Calibrated:
    """Fit a record, and write calibration.json and calibration.png beside it."""
    from labapp.calibration.pictures import overview
    from labapp.common.drawing import png

    progress = progress or Progress()
    fits = fit_record(record, progress.part(0.0, 0.9))
    file = calibration_of(fits)
    progress.report(0.9, "picture")
    write_whole(record.with_name(FILE), as_json(file))
    write_whole(record.with_name(PICTURE), png(overview(fits, file)))
    progress.report(1.0, "calibrated")
    return Calibrated(fits, file)


def completed(request: Request, bench: Bench) -> Request:
    """With what the bench knows: the star of a scene, and whether there is a dark target.

    UserError if the bench lacks the star, or its size isn't known.
    """
    table = known_star(bench, request.star, request.dark)
    known: dict[str, float] = {}
    if table is not None:
        known = {"star_diameter_um": table.diameter_um, "star_distance_m": table.distance_m}
    given = {key: value for key, value in request.model_dump().items() if value is not None}
    filled = Request.model_validate(known | given)
    if filled.asks_for("wavefront") and None in (filled.star_diameter_um, filled.star_distance_m):
        raise UserError(
            "the wavefront is judged by the star's picture: give its size and distance with "
            "--star-um and --star-m, or leave the wavefront out with --only."
        )
    return filled


def _given(camera: Camera, request: Request, nm: float) -> Exposures:
    assert request.exposure_ms is not None
    found = Found(request.exposure_ms * 1e-3, nominal_width(camera, nm))
    return exposures_of(camera, request, nm, found, 0)


def _exposures(
    bench: Bench,
    camera: Camera,
    request: Request,
    nm: float,
    folder: Path,
    progress: Progress,
    ask: Ask | None,
) -> Exposures:
    """By trial, unless it was given."""
    if request.exposure_ms is not None:
        return _given(camera, request, nm)
    trials: list[Trial] = []
    wanted = first_bracket(camera)
    for number in range(_MOST_TRIALS):
        path = folder / f"trial-{nm:g}-{number + 1}.h5"
        part = progress.part(number / _MOST_TRIALS, (number + 1) / _MOST_TRIALS)
        plan = trial_plan(request, nm, wanted)
        outcome = run_plan(bench, plan, path, source="trial", force=True, progress=part, ask=ask)
        require_complete(outcome)
        trials += _trials(outcome)
        answer = judged(trials, camera)
        if isinstance(answer, Found):
            progress.report(1.0, f"exposure, {nm:g} nm")
            return exposures_of(camera, request, nm, answer, len(trials))
        wanted = answer
    tried = ", ".join(f"{trial.exposure * 1e3:g}" for trial in trials)
    raise UserError(
        f"no exposure of the neutral star is right at {nm:g} nm; tried {tried} ms. Check that the "
        "lamp is steady, or give --exposure-ms."
    )


def _trials(outcome: Outcome) -> list[Trial]:
    with Record(outcome.path) as record:
        exposures = record.column("exposure")
        return [
            Trial(float(exposures[index]), np.asarray(record.image(index)))
            for index in range(record.frames)
        ]
