"""`labapp calibrate --camera`, on a bench or from an existing record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from labapp.bench.opening import BenchFiles, open_bench
from labapp.calibration.camera.calibrating import (
    CAMERA_FILE,
    PICTURE_FILE,
    CameraResult,
    calibrate_camera,
    fit_camera_and_write,
    prepare_camera_plan,
)
from labapp.calibration.camera.request import CameraRequest
from labapp.calibration.camera.result_report import camera_data, print_camera
from labapp.common.console import print_json, terminal_progress
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.plan_folder import PLAN_FILE, RECORD_FILE
from labapp.files.reading import format_validation_error
from labapp.files.writing import require_free_names
from labapp.runs.run_commands import (
    ExecutionOptions,
    interactive_progress,
    print_written_plan,
)


@dataclass(frozen=True)
class CameraOptions:
    """Options of `labapp calibrate --camera`; None for the default of the request."""

    flat: str | None
    dark: str
    wavelength_nm: tuple[float, ...]
    exposures: int | None
    flat_ms: float | None
    dark_s: float | None

    def request(self) -> CameraRequest:
        """Return the request that the options describe; UserError names a wrong one."""
        if len(self.wavelength_nm) > 1:
            raise UserError("--wavelength-nm: the camera is calibrated at one wavelength.")
        given = {
            "flat": self.flat,
            "dark": self.dark,
            "wavelength_nm": next(iter(self.wavelength_nm), None),
            "exposures": self.exposures,
            "flat_ms": self.flat_ms,
            "dark_s": self.dark_s,
        }
        try:
            return CameraRequest.model_validate(
                {name: value for name, value in given.items() if value is not None}
            )
        except ValidationError as error:
            raise UserError(format_validation_error(error, "calibrate --camera")) from error


def calibrate_camera_of_bench(
    options: CameraOptions, folder: Path, files: BenchFiles, execution: ExecutionOptions
) -> None:
    """Characterise a bench's camera, and print results and paths of the files."""
    request = options.request()
    names = (PLAN_FILE, RECORD_FILE, CAMERA_FILE, PICTURE_FILE)
    require_free_names(folder, names, force=execution.force)
    with (
        open_bench(files, speed=execution.speed) as bench,
        interactive_progress(execution) as (progress, ask),
    ):
        found = calibrate_camera(
            bench, request, folder, force=execution.force, progress=progress, ask=ask
        )
    _print_result(found, folder, execution.as_json)


def write_camera_plan(
    options: CameraOptions, folder: Path, files: BenchFiles, execution: ExecutionOptions
) -> None:
    """Write the plan to a folder, for `labapp run`."""
    request = options.request()
    require_free_names(folder, (PLAN_FILE,), force=execution.force)
    with open_bench(files) as bench:
        prepare_camera_plan(bench, request, folder, force=execution.force)
    fit = f"labapp calibrate --camera --fit {shell_word(folder / RECORD_FILE)}"
    print_written_plan(folder / PLAN_FILE, 0, folder / RECORD_FILE, fit, execution.as_json)


def refit_camera(record: Path, flat: str | None, execution: ExecutionOptions) -> None:
    """Fit a record again, and write the file and the picture beside it."""
    require_free_names(record.parent, (CAMERA_FILE, PICTURE_FILE), force=execution.force)
    with terminal_progress() as progress:
        found = fit_camera_and_write(record, flat, progress)
    _print_result(found, record.parent, execution.as_json)


def _print_result(found: CameraResult, folder: Path, as_json: bool) -> None:
    paths = folder / CAMERA_FILE, folder / PICTURE_FILE
    if as_json:
        print_json(camera_data(found.file, paths))
    else:
        print_camera(found.file, paths)
