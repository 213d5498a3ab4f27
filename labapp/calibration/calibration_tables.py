"""The content of calibration.json, with the facts that show later if it still holds."""

from __future__ import annotations

import math
from datetime import datetime

import labapp
from labapp.calibration.fitting import CalibrationFits, RegionFit
from labapp.files.calibration_file import (
    CalibrationFile,
    CurveTable,
    DeviceIdentityTable,
    MeasuredResponseTable,
    RegistrationTable,
    WavefrontTable,
    ZerothOrderTable,
)
from labapp.runs.record.reader import Record
from optics.measuring.registration import Registration
from optics.measuring.wavefront import WavefrontFit
from optics.measuring.zeroth_order import ZerothOrder


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
