"""All steps on one bench: trial exposures, plan, run, fits and files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import labapp
from labapp.bench.opening import Bench
from labapp.bench.star_target import require_star_target
from labapp.calibration import plan_design
from labapp.calibration.exposure_search import find_exposures, requested_exposures
from labapp.calibration.fitting import CalibrationFits, RegionFit, fit_calibration
from labapp.calibration.request import CalibrationExposures, CalibrationRequest
from labapp.common.errors import UserError
from labapp.files.calibration_file import (
    CalibrationFile,
    CurveTable,
    DeviceIdentityTable,
    MeasuredResponseTable,
    RegistrationTable,
    WavefrontTable,
    ZerothOrderTable,
    calibration_to_json,
)
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PATTERN_FOLDER, RECORD_FILE, write_plan
from labapp.files.writing import make_folder, write_atomically
from labapp.runs.acquisition.attendance import AskOperator
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import run_written_plan
from optics.camera import Camera
from optics.measuring.registration import Registration
from optics.measuring.wavefront import WavefrontFit
from optics.measuring.zeroth_order import ZerothOrder
from optics.progress import Progress

CALIBRATION_FILE, PICTURE_FILE = "calibration.json", "calibration.png"

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
    request = complete_request(request, bench)
    make_folder(folder)
    # The bench's calibration is used if it has one, because it improves the gratings.
    exposures = []
    count = len(request.wavelengths_nm)
    for number, nm in enumerate(request.wavelengths_nm):
        part = progress.part(_TRIAL_SHARE * number / count, _TRIAL_SHARE * (number + 1) / count)
        exposures.append(find_exposures(bench, request, nm, folder, part, ask))
    plan = _write_calibration_plan(bench.description, request, tuple(exposures), folder)
    run_written_plan(
        bench, plan, folder, force=force, progress=progress.part(_TRIAL_SHARE, _RUN_SHARE), ask=ask
    )
    return fit_and_write(folder / RECORD_FILE, progress.part(_RUN_SHARE, 1.0))


def _write_calibration_plan(
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


def prepare_plan_only(bench: Bench, request: CalibrationRequest, folder: Path) -> PlanFile:
    """Write plan and patterns for a later run; UserError without an exposure."""
    if request.exposure_ms is None:
        raise UserError(
            "--plan-only takes no pictures, and can't find the exposure by trial. Give "
            "--exposure-ms: of the neutral star, a little below clipping."
        )
    request = complete_request(request, bench)
    make_folder(folder)
    camera = bench.description
    exposures = [requested_exposures(camera, request, nm) for nm in request.wavelengths_nm]
    return _write_calibration_plan(camera, request, tuple(exposures), folder)


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


def build_calibration_file(fits: CalibrationFits) -> CalibrationFile:
    """Build the file's content; date, devices and bench come from the run's record."""
    with Record(fits.path) as record:
        bench = record.bench.model_dump(mode="json")
        trials = sum(exposures.trials for exposures in fits.design.exposures)
        return CalibrationFile(
            version=1,
            date=datetime.fromisoformat(record.text("start_time")),
            bench=record.bench.name,
            record=fits.path.name,
            frames=record.frame_count + trials,
            software=f"labapp {labapp.__version__}",
            devices={
                name: DeviceIdentityTable(**device) for name, device in record.devices.items()
            },
            panel=bench["panel"],
            lens=bench["lens"],
            sensor=bench["sensor"],
            polarisation=bench["polarisation"],
            registrations=tuple(
                _registration_table(nm, found, fits) for nm, found in fits.registrations.items()
            ),
            responses=tuple(
                _response_table(nm, regions, fits) for nm, regions in fits.responses.items()
            ),
            wavefront=_wavefront_table(fits.wavefront, fits.design.reference_nm)
            if fits.wavefront
            else None,
            zeroth=tuple(_zeroth_table(nm, found) for nm, found in fits.zeroth.items()),
        )


def _registration_table(nm: float, found: Registration, fits: CalibrationFits) -> RegistrationTable:
    camera, parts = fits.camera, found.parts
    scale = (parts.scale[0] * parts.scale[1]) ** 0.5
    distance = scale * camera.sensor.pitch * camera.panel.pitch / (nm * 1e-9)
    return RegistrationTable(
        wavelength_nm=nm,
        centre_px=found.centre,
        matrix_px=found.matrix.tolist(),
        covariance_px2=found.covariance.tolist(),
        uncertainty_px=found.field_uncertainty(camera.sensor.shape),
        residual_px=found.residual,
        shift_px=found.shift,
        spots=int(found.inliers.sum()),
        outliers=int((~found.inliers).sum()),
        flip=parts.flip,
        rotation_deg=math.degrees(parts.rotation),
        shear=parts.shear,
        image_distance_mm=distance * 1e3,
    )


def _response_table(
    nm: float, regions: list[RegionFit], fits: CalibrationFits
) -> MeasuredResponseTable:
    # Phases are rounded to a tenth of a milliradian.
    digits = 4
    curves = tuple(
        CurveTable(
            phase_rad=tuple(round(float(p), digits) for p in region.fit.phase),
            sigma_rad=tuple(round(float(s), digits) for s in region.fit.sigma),
            residual=region.fit.residual,
            chi2=region.fit.chi2,
            blur_px=region.fit.blur,
            ripple=region.fit.ripple,
            frames=len(region.sweep.light),
            outliers=int((~region.fit.inliers).sum()) + region.clipped_frames,
        )
        for region in regions
    )
    return MeasuredResponseTable(
        wavelength_nm=nm, regions=fits.design.request.regions, curves=curves
    )


def _wavefront_table(found: WavefrontFit, nm: float) -> WavefrontTable:
    vergence, sigma = found.vergence
    return WavefrontTable(
        wavelength_nm=nm,
        terms=found.terms,
        path_nm=(found.coefficients * 1e9).tolist(),
        covariance_nm2=(found.covariance * 1e18).tolist(),
        radius_mm=found.radius * 1e3,
        rms_nm=found.rms * 1e9,
        sigma_nm=found.sigma * 1e9,
        focus_dioptres=vergence,
        focus_sigma_dioptres=sigma,
        residual=found.residual,
        chi2=found.chi2,
    )


def _zeroth_table(nm: float, found: ZerothOrder) -> ZerothOrderTable:
    # Noise can make the estimate of a small share slightly negative.
    share = min(max(found.share, 0.0), 1.0)
    return ZerothOrderTable(
        wavelength_nm=nm, share=share, sigma=found.sigma, frames=len(found.by_frame)
    )
