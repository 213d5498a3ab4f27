"""`labapp calibrate --spectra`, on a bench or from a record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from labapp.bench.opening import BenchFiles
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
from labapp.spectral.lights import ViewingLight, find_light
from labapp.spectral_calibration.calibrating import (
    PICTURE_FILE,
    RADIANCE_FILE,
    SPECTRA_FILE,
    SpectraJob,
    SpectraResult,
    calibrate_spectra,
    fit_and_write_spectra,
    prepare_spectra_plan,
)
from labapp.spectral_calibration.request import (
    SpectraRequest,
    bands_of_plan,
    read_snapshot_plan,
)
from labapp.spectral_calibration.result_report import print_spectra, spectra_data


@dataclass(frozen=True)
class SpectraOptions:
    """Options of `labapp calibrate --spectra`.

    plan: path or bundled name of the plan whose coded pattern is calibrated.
    lamp: CIE illuminant, or CSV file of the lamp's spectrum.
    """

    wavelengths_nm: tuple[float, ...]
    plan: str | None
    flat: str
    star: str
    dark: str
    star_um: float | None
    star_m: float | None
    exposure_ms: float | None
    flat_ms: float | None
    lamp: str | None

    def job(self, folder: Path, files: BenchFiles) -> SpectraJob:
        """Return the job that the options describe; UserError names a wrong one.

        `folder` is that of the results.
        """
        source = read_snapshot_plan(self.plan)
        roles = source.plan.reconstruct
        assert roles is not None
        data: dict[str, Any] = {
            "bands_nm": sorted(set(self.wavelengths_nm)) or bands_of_plan(source),
            "star": self.star,
            "flat": self.flat,
            "dark": self.dark,
            "neutral": roles.neutral,
            "coded": roles.coded,
            "window_px": roles.psf_window_px,
            "exposure_ms": self.exposure_ms,
            "flat_ms": self.flat_ms,
            "star_diameter_um": self.star_um or 0.0,
            "star_distance_m": self.star_m,
        }
        if len(data["bands_nm"]) < 2:
            raise UserError(
                f"--wavelength-nm {data['bands_nm'][0]:g}: is one band, and --spectra needs two or "
                "more. Repeat the option for each band."
            )
        try:
            request = SpectraRequest.model_validate(data)
        except ValidationError as error:
            raise UserError(format_validation_error(error, "calibrate --spectra")) from error
        return SpectraJob(files, source, request, folder, _lamp(self.lamp))


def calibrate_spectra_of_bench(
    options: SpectraOptions, folder: Path, files: BenchFiles, execution: ExecutionOptions
) -> None:
    """Calibrate a camera on its bench, and print results and paths of the files."""
    job = options.job(folder, files)
    require_free_names(
        folder,
        (PLAN_FILE, RECORD_FILE, RADIANCE_FILE, SPECTRA_FILE, PICTURE_FILE),
        force=execution.force,
    )
    with interactive_progress(execution) as (progress, ask):
        found = calibrate_spectra(job, progress, ask, speed=execution.speed, force=execution.force)
    _print_result(found, folder, execution.as_json)


def write_spectra_plan(
    options: SpectraOptions, folder: Path, files: BenchFiles, execution: ExecutionOptions
) -> None:
    """Write plan and patterns to a folder, for `labapp run`."""
    require_free_names(folder, (PLAN_FILE,), force=execution.force)
    plan = prepare_spectra_plan(options.job(folder, files))
    fit = f"labapp calibrate --spectra --fit {shell_word(folder / RECORD_FILE)}"
    print_written_plan(
        folder / PLAN_FILE, len(plan.patterns), folder / RECORD_FILE, fit, execution.as_json
    )


def refit_spectra(record: Path, lamp: str | None, execution: ExecutionOptions) -> None:
    """Fit a record again, and write file and picture beside it."""
    require_free_names(record.parent, (SPECTRA_FILE, PICTURE_FILE), force=execution.force)
    with terminal_progress() as progress:
        found = fit_and_write_spectra(record, _lamp(lamp), progress)
    _print_result(found, record.parent, execution.as_json)


def _lamp(name: str | None) -> ViewingLight | None:
    """Return the lamp of the option --lamp; UserError names the option."""
    try:
        return None if name is None else find_light(name)
    except UserError as error:
        raise UserError(str(error).replace("--light", "--lamp", 1)) from error


def _print_result(found: SpectraResult, folder: Path, as_json: bool) -> None:
    paths = folder / SPECTRA_FILE, folder / PICTURE_FILE
    if as_json:
        print_json(spectra_data(found.file, paths))
    else:
        print_spectra(found.file, paths)
