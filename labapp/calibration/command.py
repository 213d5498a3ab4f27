"""`labapp calibrate` of panel and lens, or of the camera, on a bench or from an existing record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.calibration import calibrating
from labapp.calibration.calibrating import CalibrationResult
from labapp.calibration.camera import calibrating as camera_calibrating
from labapp.calibration.camera.calibrating import CAMERA_FILE, CameraResult
from labapp.calibration.camera.plan_design import CameraRequest
from labapp.calibration.camera.result_report import camera_data, print_camera
from labapp.calibration.request import CalibrationRequest
from labapp.calibration.result_report import print_tables, result_data
from labapp.common.console import print_json, terminal_progress
from labapp.common.plain_text import shell_word
from labapp.files.grey_table import ImagePattern
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PLAN_FILE, RECORD_FILE
from labapp.files.reading import validate
from labapp.files.writing import require_free_names
from labapp.runs.run_commands import ExecutionOptions, interactive_progress, print_written_plan


@dataclass(frozen=True)
class Calibration:
    """A kind of calibration: its command and files, its steps on a bench, and its output.

    results: names of the files that a fit writes.
    """

    command: str
    request: type[CalibrationRequest | CameraRequest]
    results: tuple[str, str]
    calibrate: Callable[..., Any]
    prepare_plan: Callable[[Bench, Any, Path], PlanFile]
    fit: Callable[..., Any]
    print_result: Callable[[Any, Path, bool], None]

    def read_request(self, asked: dict[str, Any]) -> CalibrationRequest | CameraRequest:
        """Return the request for what was asked; None leaves a key at its default.

        Raises UserError with the name of a wrong key.
        """
        given = {name: value for name, value in asked.items() if value is not None}
        return validate(given, self.request, self.command)

    def take_and_fit(
        self,
        request: CalibrationRequest | CameraRequest,
        folder: Path,
        files: BenchFiles,
        execution: ExecutionOptions,
    ) -> None:
        """Take and fit all frames on a bench, and print the results and the paths of the files."""
        force = execution.force
        require_free_names(folder, (PLAN_FILE, RECORD_FILE, *self.results), force=force)
        with (
            open_bench(files, speed=execution.speed) as bench,
            interactive_progress(execution) as (progress, ask),
        ):
            found = self.calibrate(bench, request, folder, force=force, progress=progress, ask=ask)
        self.print_result(found, folder, execution.as_json)

    def write_plan(
        self,
        request: CalibrationRequest | CameraRequest,
        folder: Path,
        files: BenchFiles,
        execution: ExecutionOptions,
    ) -> None:
        """Write plan and patterns to a folder, for `labapp run`."""
        require_free_names(folder, (PLAN_FILE,), force=execution.force)
        with open_bench(files) as bench:
            plan = self.prepare_plan(bench, request, folder)
        record = folder / RECORD_FILE
        pictures = sum(isinstance(one, ImagePattern) for one in plan.patterns.values())
        fit = f"labapp {self.command} --fit {shell_word(record)}"
        print_written_plan(folder / PLAN_FILE, pictures, record, fit, execution.as_json)

    def refit(self, record: Path, execution: ExecutionOptions, **chosen: Any) -> None:
        """Fit a record again, and write the file and the picture beside it."""
        require_free_names(record.parent, self.results, force=execution.force)
        with terminal_progress() as progress:
            found = self.fit(record, progress=progress, **chosen)
        self.print_result(found, record.parent, execution.as_json)


def _print_panel(found: CalibrationResult, folder: Path, as_json: bool) -> None:
    if as_json:
        print_json(result_data(found, folder))
    else:
        print_tables(found, folder)


def _print_camera(found: CameraResult, folder: Path, as_json: bool) -> None:
    paths = folder / CAMERA_FILE, folder / camera_calibrating.PICTURE_FILE
    if as_json:
        print_json(camera_data(found.file, paths))
    else:
        print_camera(found.file, paths)


PANEL = Calibration(
    "calibrate",
    CalibrationRequest,
    (calibrating.CALIBRATION_FILE, calibrating.PICTURE_FILE),
    calibrating.calibrate,
    calibrating.prepare_plan_only,
    calibrating.fit_and_write,
    _print_panel,
)
CAMERA = Calibration(
    "calibrate --camera",
    CameraRequest,
    (CAMERA_FILE, camera_calibrating.PICTURE_FILE),
    camera_calibrating.calibrate_camera,
    camera_calibrating.prepare_camera_plan,
    camera_calibrating.fit_camera_and_write,
    _print_camera,
)
