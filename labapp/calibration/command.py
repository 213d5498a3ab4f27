"""`labapp calibrate`, on a bench or from an existing record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from labapp.bench.opening import BenchFiles, open_bench
from labapp.calibration.calibrating import (
    CALIBRATION_FILE,
    PICTURE_FILE,
    CalibrationResult,
    calibrate,
    fit_and_write,
    prepare_plan_only,
)
from labapp.calibration.request import CalibrationRequest
from labapp.calibration.result_report import print_tables, result_data
from labapp.common.console import print_json, terminal_progress
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.common.typed_numbers import parse_whole
from labapp.files.plan_folder import PLAN_FILE, RECORD_FILE
from labapp.files.reading import format_validation_error
from labapp.files.writing import require_free_names
from labapp.runs.run_commands import (
    ExecutionOptions,
    interactive_progress,
    print_written_plan,
)


@dataclass(frozen=True)
class CalibrateOptions:
    """Options of `labapp calibrate`.

    regions: rows and columns of the panel's regions, such as "2x2".
    only: the parts to measure; all if empty.
    """

    wavelengths_nm: tuple[float, ...]
    regions: str
    only: tuple[str, ...]
    levels: int
    exposure_ms: float | None
    star: str
    dark: str
    star_um: float | None
    star_m: float | None

    def request(self) -> CalibrationRequest:
        """Return the request that the options describe.

        Raises UserError with the name of a wrong option.
        """
        try:
            rows, columns = (parse_whole(one) for one in self.regions.split("x"))
        except ValueError as error:
            raise UserError(f"--regions {self.regions}: give rows x columns, as in 2x2.") from error
        data: dict[str, Any] = {
            "wavelengths_nm": sorted(set(self.wavelengths_nm)),
            "regions": (rows, columns),
            "levels": self.levels,
            "exposure_ms": self.exposure_ms,
            "star": self.star,
            "dark": self.dark,
            "star_diameter_um": self.star_um,
            "star_distance_m": self.star_m,
        }
        if self.only:
            data["parts"] = self.only
        try:
            return CalibrationRequest.model_validate(data)
        except ValidationError as error:
            raise UserError(format_validation_error(error, "calibrate")) from error


def calibrate_bench(
    options: CalibrateOptions, folder: Path, files: BenchFiles, execution: ExecutionOptions
) -> None:
    """Take and fit all frames on a bench, and print the results and the paths of the files."""
    request = options.request()
    require_free_names(
        folder, (PLAN_FILE, RECORD_FILE, CALIBRATION_FILE, PICTURE_FILE), force=execution.force
    )
    with (
        open_bench(files, speed=execution.speed) as bench,
        interactive_progress(execution) as (progress, ask),
    ):
        found = calibrate(bench, request, folder, force=execution.force, progress=progress, ask=ask)
    _print_result(found, folder, execution.as_json)


def write_plan_only(
    options: CalibrateOptions, folder: Path, files: BenchFiles, execution: ExecutionOptions
) -> None:
    """Write plan and patterns to a folder, for `labapp run`."""
    request = options.request()
    require_free_names(folder, (PLAN_FILE,), force=execution.force)
    with open_bench(files) as bench:
        plan = prepare_plan_only(bench, request, folder, force=execution.force)
    fit = f"labapp calibrate --fit {shell_word(folder / RECORD_FILE)}"
    print_written_plan(
        folder / PLAN_FILE, len(plan.patterns), folder / RECORD_FILE, fit, execution.as_json
    )


def refit_record(record: Path, execution: ExecutionOptions) -> None:
    """Fit a record again, and write the file and the picture beside it."""
    require_free_names(record.parent, (CALIBRATION_FILE, PICTURE_FILE), force=execution.force)
    with terminal_progress() as progress:
        found = fit_and_write(record, progress)
    _print_result(found, record.parent, execution.as_json)


def _print_result(found: CalibrationResult, folder: Path, as_json: bool) -> None:
    if as_json:
        print_json(result_data(found, folder))
    else:
        print_tables(found, folder)
