"""All steps from a bench to spectra.json: radiances, trials, plan, run, fit and files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import torch

import labapp
from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.bench.star_target import require_star_target
from labapp.common.errors import UserError
from labapp.files.calibration_file import DeviceIdentityTable, calibration_to_json
from labapp.files.plan_file import NamedPlan, PlanFile
from labapp.files.plan_folder import RECORD_FILE, write_plan
from labapp.files.spectra_file import (
    BandTable,
    ParameterTable,
    SpectraFile,
    TransmissionTable,
    as_ppm,
    name_bands,
)
from labapp.files.writing import make_folder, write_atomically
from labapp.patterns.grey_levels import compute_patterns
from labapp.runs.acquisition.attendance import AskOperator
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import run_written_plan
from labapp.spectral.lights import ViewingLight
from labapp.spectral.snapshot_prior import require_filters, usual_uncertainty_in_words
from labapp.spectral_calibration.exposure_search import find_exposures
from labapp.spectral_calibration.fitting import SpectraFit, fit_spectra
from labapp.spectral_calibration.plan_design import build_spectra_plan
from labapp.spectral_calibration.radiances import (
    measure_radiances,
    radiances_to_csv,
    read_radiances,
    transmission_tables,
)
from labapp.spectral_calibration.request import SpectraRequest
from optics.multispectral import CalibratedParameter
from optics.progress import Progress

RADIANCE_FILE = "radiances.csv"
SPECTRA_FILE, PICTURE_FILE = "spectra.json", "spectra.png"


_DIGITS = 6  # significant digits of the model's numbers; their errors are larger

_NO_LAMP = (
    "The filter's own transmission: only the product of lamp and filter was seen. It matters for "
    "photographs that are taken without the filter."
)


@dataclass(frozen=True)
class SpectraJob:
    """What is measured, and where: `source` is the plan whose coded pattern is calibrated."""

    files: BenchFiles
    source: NamedPlan
    request: SpectraRequest
    folder: Path
    lamp: ViewingLight | None


def calibrate_spectra(
    job: SpectraJob, progress: Progress, ask: AskOperator, *, speed: float, force: bool
) -> SpectraFile:
    """Measure radiances, find exposures, take frames, fit them, and write the files.

    The folder gets radiances.csv (where there is a spectroradiometer), plan.toml, patterns/,
    run.h5, spectra.json and spectra.png. Raises UserError, which says what is wrong at the bench,
    and Cancelled if the progress was cancelled.
    """
    make_folder(job.folder)
    with open_bench(job.files, speed=speed) as bench:
        request = _complete_request(job.request, bench)
        exposures = find_exposures(bench, request, job.folder, progress.part(0, 0.2), ask)
        plan = _write_plan(bench, job, request, exposures, progress.part(0.2, 0.25))
        run_written_plan(
            bench, plan, job.folder, force=force, progress=progress.part(0.25, 0.75), ask=ask
        )
    seen = measure_radiances(job.files, request, progress.part(0.75, 0.8), ask, speed)
    if seen is not None:
        write_atomically(job.folder / RADIANCE_FILE, radiances_to_csv(seen))
    else:
        # Radiances of an earlier calibration don't belong to this one.
        (job.folder / RADIANCE_FILE).unlink(missing_ok=True)
    return fit_and_write_spectra(job.folder / RECORD_FILE, job.lamp, progress.part(0.8, 1))


def prepare_spectra_plan(job: SpectraJob) -> PlanFile:
    """Write plan and patterns for a later run, without any picture.

    Raises UserError without exposures.
    """
    stated = {"--exposure-ms": job.request.exposure_ms, "--flat-ms": job.request.flat_ms}
    for option, value in stated.items():
        if value is None:
            raise UserError(
                f"--plan-only takes no pictures, and can't find exposures by trial. Give {option}: "
                "a little below clipping."
            )
    make_folder(job.folder)
    with open_bench(job.files) as bench:
        request = _complete_request(job.request, bench)
        # All exposures are stated, so that no frame is taken.
        exposures = find_exposures(bench, request, job.folder, Progress(), None)
        return _write_plan(bench, job, request, exposures, Progress())


def fit_and_write_spectra(
    record: Path, lamp: ViewingLight | None, progress: Progress
) -> SpectraFile:
    """Fit a record, and write spectra.json and spectra.png beside it.

    Radiances are read from radiances.csv beside the record, if it is there.
    """
    from labapp.common.figure_png import figure_to_png
    from labapp.spectral_calibration.overview_figure import draw_spectra

    fit = fit_spectra(record, progress.part(0.0, 0.9))
    seen = read_radiances(record.with_name(RADIANCE_FILE), fit.request.bands_nm)
    file = _build_spectra_file(fit, *transmission_tables(seen, lamp))
    progress.report(0.9, "picture")
    write_atomically(record.with_name(SPECTRA_FILE), calibration_to_json(file))
    write_atomically(record.with_name(PICTURE_FILE), figure_to_png(draw_spectra(fit, file, seen)))
    progress.report(1.0, "calibrated")
    return file


def _complete_request(request: SpectraRequest, bench: Bench) -> SpectraRequest:
    """Add the star's size and distance as the bench's scene has them.

    Raises UserError if the bench lacks a target or colour filters.
    """
    require_filters("--spectra", bench.description.sensor.colour)
    table = require_star_target(bench, request.star, request.dark)
    if request.flat not in bench.targets.names:
        raise UserError(
            f"--flat {request.flat}: this bench has no such target. Name the one that is a white "
            f"sheet, among {', '.join(bench.targets.names)}."
        )
    known: dict[str, float] = {}
    if table is not None:
        known = {"star_diameter_um": table.diameter_um, "star_distance_m": table.distance_m}
    given = {key: value for key, value in request.model_dump().items() if value}
    return SpectraRequest.model_validate(known | given | {"dark": request.dark})


def _write_plan(
    bench: Bench,
    job: SpectraJob,
    request: SpectraRequest,
    exposures: dict[tuple[str, float], float],
    progress: Progress,
) -> PlanFile:
    """Compute the patterns, and write them with their plan to the job's folder."""
    plan = job.source.plan
    specs = {one: plan.patterns[one] for one in (request.neutral, request.coded)}
    shown = compute_patterns(specs, bench.description, plan.seed, progress, job.source.path.parent)
    for name, grey in shown.items():
        if grey.ndim != 2:
            raise UserError(
                f"--plan {job.source.name}: the pattern {name!r} is a video, whose PSF isn't "
                "calibrated. Name a plan with a still one."
            )
    made = build_spectra_plan(request, shown, exposures, bench.description.sensor)
    write_plan(job.folder, made, shown)
    return made


def _build_spectra_file(
    fit: SpectraFit, transmission: tuple[TransmissionTable, ...], transmission_source: str
) -> SpectraFile:
    """Build the file's content; date, devices and bench come from the run's record."""
    found, model, response = fit.found, fit.found.model, fit.found.response
    order = model.zeroth_order[:, None, None]
    bands = fit.request.wavelengths
    known = bool(transmission) and all(one.relative is not None for one in transmission)
    with Record(fit.path) as record:
        bench = record.bench.model_dump(mode="json")
        return SpectraFile(
            version=1,
            date=datetime.fromisoformat(record.text("start_time")),
            bench=record.bench.name,
            record=fit.path.name,
            frames=record.frame_count,
            software=f"labapp {labapp.__version__}",
            devices={
                name: DeviceIdentityTable(**device) for name, device in record.devices.items()
            },
            sensor=bench["sensor"],
            pitch_um=record.camera.sensor.pitch * 1e6,
            coded_pattern=fit.request.coded,
            coded_sha256=fit.coded_sha256,
            nominal_source=_nominal_in_words(fit),
            transmission_source=transmission_source,
            indeterminate=(*found.indeterminate, *(() if known else (_NO_LAMP,))),
            parameters=tuple(_parameter_table(one, bands) for one in found.parameters),
            bands=tuple(
                BandTable(
                    wavelength_nm=nm,
                    white_e_per_s=_round_number(float(response[:, band].max())),
                    light_share=_round_number(float(fit.light_share[band])),
                    star_residual=_round_number(float(fit.star_residuals[band])),
                )
                for band, nm in enumerate(fit.request.bands_nm)
            ),
            transmission=transmission,
            filters=model.pattern,
            channels=model.channels,
            zeroth_order=_row(model.zeroth_order),
            response=tuple(_row(one) for one in model.response),
            deviation=_row(found.deviation),
            covariance=tuple(_row(one) for one in found.covariance),
            psfs_ppm=as_ppm((order * model.neutral + (1 - order) * model.coded).numpy()),
            neutral_ppm=as_ppm(model.neutral.numpy()),
        )


def _nominal_in_words(fit: SpectraFit) -> str:
    """Say in words what the nominal model is, and how well it was known."""
    request = fit.request
    star = (
        f"fitted as those of a star of {request.star_diameter_um:g} µm"
        if request.star_diameter_um
        else "fitted as if the star were a point, as its size isn't known"
    )
    return (
        f"PSFs of a point, computed from the bench's description and the pattern "
        f"{request.coded!r}, and {star}; before the fit, {usual_uncertainty_in_words()}"
    )


def _parameter_table(one: CalibratedParameter, wavelengths: Sequence[float]) -> ParameterTable:
    exact = (one.value, one.deviation, one.lower, one.upper, one.nominal)
    value, sigma, lower, upper, nominal = map(_round_number, exact)
    return ParameterTable(
        name=name_bands(one.name, wavelengths),
        unit=one.unit.replace("pixel", "px"),
        value=value,
        sigma=sigma,
        lower=lower,
        upper=upper,
        nominal=nominal,
    )


def _row(values: torch.Tensor) -> tuple[float, ...]:
    return tuple(_round_number(float(one)) for one in values)


def _round_number(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
