"""All steps for a bench's camera: trial exposures, plan, run, fit and files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from labapp.bench.opening import Bench
from labapp.calibration.camera.exposure_search import find_longest_exposure
from labapp.calibration.camera.noise_tables import build_noise_file
from labapp.calibration.camera.plan_design import build_camera_plan
from labapp.calibration.camera.recorded_frames import RecordedPairs, read_pairs
from labapp.calibration.camera.request import CameraRequest
from labapp.common.errors import UserError
from labapp.files.calibration_file import calibration_to_json
from labapp.files.camera_noise_file import CameraNoiseFile
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PLAN_FILE, RECORD_FILE, write_plan
from labapp.files.writing import make_folder, require_free_names, write_atomically
from labapp.runs.acquisition.attendance import AskOperator
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import run_written_plan
from optics.measuring import CameraNoise, characterise_camera
from optics.progress import Progress

CAMERA_FILE, PICTURE_FILE = "camera.json", "camera.png"

_TRIAL_SHARE, _RUN_SHARE = 0.1, 0.7
"""Shares of the progress that are reached after the trials and after the run."""


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
    require_free_names(folder, (PLAN_FILE, RECORD_FILE, CAMERA_FILE, PICTURE_FILE), force=force)
    _require_targets(bench, request)
    make_folder(folder)
    if request.flat_ms is None:
        found = find_longest_exposure(bench, request, folder, progress.part(0, _TRIAL_SHARE), ask)
        changes = {"flat_ms": found.exposure * 1e3, "trials": found.trials}
        request = request.model_copy(update=changes)
    plan = _write_plan(bench, request, folder)
    run_written_plan(
        bench, plan, folder, force=force, progress=progress.part(_TRIAL_SHARE, _RUN_SHARE), ask=ask
    )
    return fit_camera_and_write(folder / RECORD_FILE, progress=progress.part(_RUN_SHARE, 1.0))


def prepare_camera_plan(
    bench: Bench, request: CameraRequest, folder: Path, *, force: bool = False
) -> PlanFile:
    """Write the plan for a later run; UserError without an exposure."""
    require_free_names(folder, (PLAN_FILE,), force=force)
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
        noise = _characterise(path, pairs)
        file = build_noise_file(record, pairs, noise)
    progress.report(0.8, "picture")
    write_atomically(path.with_name(CAMERA_FILE), calibration_to_json(file))
    write_atomically(path.with_name(PICTURE_FILE), figure_to_png(draw_camera(noise, file)))
    progress.report(1.0, "calibrated")
    return CameraResult(noise, file)


def _characterise(path: Path, pairs: RecordedPairs) -> CameraNoise:
    """Characterise the camera from pairs of frames; UserError names the record."""
    try:
        return characterise_camera(pairs.frames)
    except ValueError as error:
        raise UserError(f"{path}: {error}.") from error


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
