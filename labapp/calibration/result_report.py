"""Results as tables, and advice on what to do at the bench."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from labapp.calibration.calibrating import CALIBRATION_FILE, CalibrationResult
from labapp.common.console import out, print_message, print_table
from labapp.files.calibration_file import CalibrationFile, RegistrationTable

# Limits beyond which advice is given. All are chosen.
_LEAST_MARGIN = 10.0  # of the information criterion to a fit with another number of waves
_MOST_PHASE_SIGMA = 0.05  # uncertainty of the phase response, radians
_MOST_UNCERTAINTY_PX = 0.2  # of the registration, pixels
_MOST_BLUR_PX = 1.0  # of the phase by neighbouring pixels, panel pixels
_MOST_SHIFT_PX = 1.0  # of the steered spots beside the zeroth order's map, pixels
_MOST_UNMODULATED = 0.15  # share of unmodulated light
_FOCUS_SIGMAS = 3.0  # standard deviations from which a focus error counts as real

Row = list[str]


def result_data(result: CalibrationResult, folder: Path) -> dict[str, Any]:
    """Return results and advice as plain data, without the phase curves themselves."""
    file = result.file
    kept = {"phase_rad", "sigma_rad"}
    responses = [
        {
            "wavelength_nm": response.wavelength_nm,
            "regions": response.regions,
            "curves": [
                curve.model_dump(mode="json", exclude=kept)
                | {
                    "reach_rad": curve.phase_rad[-1] - curve.phase_rad[0],
                    "sigma_max_rad": max(curve.sigma_rad),
                }
                for curve in response.curves
            ],
        }
        for response in file.responses
    ]
    return file.model_dump(
        mode="json", include={"date", "bench", "frames", "registrations", "wavefront", "zeroth"}
    ) | {"file": str(folder / CALIBRATION_FILE), "responses": responses, "advice": advice(result)}


def print_tables(result: CalibrationResult, folder: Path) -> None:
    """Print results with uncertainties, advice, and how to use the file."""
    file = result.file
    print_table("Calibration", ["what", "found", "how well", "from"], result_rows(file))
    for line in advice(result):
        print_message(line)
    out.print(f"wrote {folder / CALIBRATION_FILE}; put it in force with a line in the bench file:")
    out.print(f'calibration = "{folder / CALIBRATION_FILE}"')


def result_rows(file: CalibrationFile) -> list[Row]:
    """Return the printed rows of the results."""
    found: list[Row] = []
    for one in file.registrations:
        y, x = one.centre_px
        found += [
            [
                f"registration, {one.wavelength_nm:g} nm",
                f"flip {one.flip}, turned {one.rotation_deg:+.3f}°, shear {one.shear:+.4f}",
                f"± {one.uncertainty_px:.3f} px in the worst corner",
                f"{one.spots} spots, residual {one.residual_px:.3f} px",
            ],
            [
                f"zeroth order, {one.wavelength_nm:g} nm",
                f"row {y:.2f}, column {x:.2f}",
                f"± {one.covariance_px2[0][0] ** 0.5:.3f} px",
                f"lever of {one.image_distance_mm:.2f} mm on the sensor by the scale",
            ],
        ]
    for response in file.responses:
        for number, curve in enumerate(response.curves):
            row, column = divmod(number, response.regions[1])
            reach = (curve.phase_rad[-1] - curve.phase_rad[0]) / math.pi
            left_out = f", {curve.outliers} left out" if curve.outliers else ""
            found.append(
                [
                    f"response, {response.wavelength_nm:g} nm, region {row + 1},{column + 1}",
                    f"0 to {reach:.3f} π",
                    f"± {max(curve.sigma_rad):.3f} rad at most",
                    f"{curve.frames} frames{left_out}, "
                    f"residual {100 * curve.residual:.2f} % of the swing",
                ]
            )
    for zeroth in file.zeroth:
        name = f"unmodulated light, {zeroth.wavelength_nm:g} nm"
        share, sigma = f"{100 * zeroth.share:.2f} %", f"± {100 * zeroth.sigma:.2f} %"
        found.append([name, share, sigma, f"{zeroth.frames} gratings"])
    if (wave := file.wavefront) is not None:
        found += [
            [
                f"wavefront, {wave.wavelength_nm:g} nm",
                f"{wave.rms_nm:.1f} nm rms",
                f"± {wave.sigma_nm:.1f} nm",
                f"residual {100 * wave.residual:.1f} % of the star's pictures",
            ],
            [
                "focus error",
                f"{wave.focus_dioptres:+.4f} dioptres",
                f"± {wave.focus_sigma_dioptres:.4f} dioptres",
                "the same pictures",
            ],
        ]
    return found


def advice(result: CalibrationResult) -> list[str]:
    """Return what to check or change at the bench, in sentences.

    The list is empty if all is good.
    """
    file = result.file
    said = [*_registration_advice(file.registrations), *_response_advice(result)]
    for one in file.zeroth:
        if one.share > _MOST_UNMODULATED:
            said.append(
                f"{100 * one.share:.0f} % of the light at {one.wavelength_nm:g} nm ignores the "
                "pattern: turn the polariser until the middle of a steered star is darkest."
            )
    found = file.wavefront
    if found and abs(found.focus_dioptres) >= _FOCUS_SIGMAS * found.focus_sigma_dioptres:
        shift = found.focus_dioptres * result.fits.camera.ray_matrix_b**2
        side = "away from" if shift > 0 else "towards"
        said.append(
            f"the star is {found.focus_dioptres:+.3f} dioptres out of focus. The calibration takes "
            f"it in; or move the sensor {abs(shift) * 1e3:.3f} mm {side} the lens, and calibrate "
            "again."
        )
    return said


def _registration_advice(tables: Sequence[RegistrationTable]) -> list[str]:
    said = []
    for one in tables:
        if one.outliers:
            said.append(
                f"{one.outliers} of {one.outliers + one.spots} spots at {one.wavelength_nm:g} nm "
                "were no spots of the panel: look for reflections and stray light."
            )
        if one.uncertainty_px > _MOST_UNCERTAINTY_PX:
            said.append(
                f"the registration is known to {one.uncertainty_px:.2f} px only: focus the star, "
                "expose it longer (--exposure-ms), or use a smaller pinhole."
            )
        if max(abs(s) for s in one.shift_px) > _MOST_SHIFT_PX:
            said.append(
                f"steered spots lay {one.shift_px[0]:+.1f}, {one.shift_px[1]:+.1f} px (y, x) "
                "beside the zeroth order's map: the response differs over the panel. Calibrate "
                "again with this calibration in force."
            )
    return said


def _response_advice(result: CalibrationResult) -> list[str]:
    said = []
    for nm, regions in result.fits.responses.items():
        for number, region in enumerate(regions):
            where = f"region {number + 1} at {nm:g} nm"
            fit = region.fit
            if fit.rival_margin < _LEAST_MARGIN:
                said.append(
                    f"{where}: the count of waves is in doubt; sweep more levels (--levels)."
                )
            if float(fit.sigma.max()) > _MOST_PHASE_SIGMA:
                said.append(
                    f"{where}: the phase is known to {fit.sigma.max():.2f} rad only; brighten the "
                    "lamp, or choose fewer regions, so that their spots are brighter."
                )
            if fit.blur > _MOST_BLUR_PX:
                said.append(
                    f"{where}: neighbours blur the phase over {fit.blur:.1f} pixels; expect weak "
                    "steep gratings, and check that the display isn't scaled."
                )
            if region.clipped_frames:
                said.append(
                    f"{where}: {region.clipped_frames} frames had clipped spots and were left out; "
                    "expose shorter (--exposure-ms)."
                )
    return said
