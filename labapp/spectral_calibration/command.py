"""`labapp calibrate --spectra`, on a bench or from a record: results, and advice on the bench."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.bench.opening import BenchFiles
from labapp.common.console import (
    out,
    print_json,
    print_message,
    print_table,
    terminal_progress,
)
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.plan_folder import PLAN_FILE, RECORD_FILE
from labapp.files.reading import validate
from labapp.files.spectra_file import SpectraFile
from labapp.files.writing import require_free_names
from labapp.runs.run_commands import (
    ExecutionOptions,
    interactive_progress,
    print_written_plan,
)
from labapp.spectral.lights import ViewingLight, find_light
from labapp.spectral.refinement import format_estimate
from labapp.spectral_calibration.calibrating import (
    PICTURE_FILE,
    RADIANCE_FILE,
    SPECTRA_FILE,
    SpectraJob,
    calibrate_spectra,
    fit_and_write_spectra,
    prepare_spectra_plan,
)
from labapp.spectral_calibration.request import (
    SpectraRequest,
    bands_of_plan,
    read_snapshot_plan,
)

# Residual of a star's picture, relative to it, from which the model counts as wrong. Chosen:
# interpolation and a star's own size leave a tenth.
_LARGE_RESIDUAL = 0.25

_LARGE_CHANGE = 4.0  # nominal standard deviations by which a parameter is off, to be named

_MODEL_KEYS = {"psfs_ppm", "neutral_ppm", "covariance", "deviation", "zeroth_order", "response"}


@dataclass(frozen=True)
class SpectraOptions:
    """Options of `labapp calibrate --spectra`: `lamp` is a CIE illuminant, or a CSV file."""

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
        """Return the job with results in `folder`; UserError names a wrong option."""
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
        request = validate(data, SpectraRequest, "calibrate --spectra")
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


def _print_result(file: SpectraFile, folder: Path, as_json: bool) -> None:
    paths = folder / SPECTRA_FILE, folder / PICTURE_FILE
    if as_json:
        print_json(spectra_data(file, paths))
    else:
        _print_tables(file, paths)


def spectra_data(file: SpectraFile, paths: tuple[Path, ...]) -> dict[str, Any]:
    """Return the results as plain data, without the model's own numbers."""
    return file.model_dump(mode="json", exclude=_MODEL_KEYS) | {
        "advice": advice(file),
        "files": [str(one) for one in paths],
    }


def _print_tables(file: SpectraFile, paths: tuple[Path, ...]) -> None:
    """Print parameters, bands, advice, and how to use the file."""
    rows = [
        [one.name, *format_estimate(one.value, one.sigma, one.unit), f"{one.nominal:.4g}"]
        for one in file.parameters
    ]
    print_table("Spectral calibration", ["what", "found ", "", "nominal "], rows)
    heads = ["band ", "white, e/s ", "share of light ", "star's residual "]
    rows = [
        [
            f"{one.wavelength_nm:g} nm",
            f"{one.white_e_per_s:.3g}",
            f"{one.light_share:.3f}",
            f"{one.star_residual:.1%}".replace("%", " %"),
        ]
        for one in file.bands
    ]
    print_table("Bands", heads, rows)
    if file.transmission:
        heads = ["band ", "centre nm ", "width nm ", "W/(sr m²) ", "filter's transmission "]
        print_table("Light of the white sheet", heads, _light_rows(file))
    print_message(f"transmission: {file.transmission_source}")
    for line in advice(file):
        print_message(line)
    for line in file.indeterminate:
        print_message(f"indeterminate: {line}")
    for path in paths:
        out.print(f"wrote {path}", soft_wrap=True)
    out.print(
        f"labapp reconstruct RUN.h5 --bands all --calibration {shell_word(paths[0])}",
        soft_wrap=True,
    )


def _light_rows(file: SpectraFile) -> list[list[str]]:
    """Return a printed row for each band on what the spectroradiometer saw."""
    rows = []
    for band, seen in zip(file.bands, file.transmission, strict=False):
        numbers = (
            f"{seen.wavelength_nm:.1f}",
            f"{seen.width_nm:.1f}",
            f"{seen.radiance_w_sr_m2:.3g}",
        )
        known = "not known"
        if seen.relative is not None and seen.sigma is not None:
            known = f"{seen.relative:.3f} ± {seen.sigma:.3f}"
        rows.append([f"{band.wavelength_nm:g} nm", *numbers, known])
    return rows


def advice(file: SpectraFile) -> list[str]:
    """Return what to do at the bench, in sentences."""
    said = []
    wrong = [one for one in file.bands if one.star_residual > _LARGE_RESIDUAL]
    if wrong:
        listed = ", ".join(f"{one.wavelength_nm:g}" for one in wrong)
        said.append(
            f"The computed PSFs explain the star badly at {listed} nm. Calibrate the panel first "
            "(labapp calibrate), focus the star, or use the measured PSFs: labapp reconstruct "
            f"RUN.h5 --bands all --psf {shell_word(file.record)}"
        )
    moved = [
        one for one in file.parameters
        if one.unit == "px" and abs(one.value) > 1.0 + _LARGE_CHANGE * one.sigma
    ]  # fmt: skip
    if moved:
        said.append(
            f"{moved[0].name}: {moved[0].value:+.2f} px beside the other bands. Lens and filter "
            "displace colours; the calibration accounts for it."
        )
    return said
