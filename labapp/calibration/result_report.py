"""Results as tables, and advice on what to do at the bench."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.calibration.calibrating import CALIBRATION_FILE, CalibrationResult
from labapp.common.console import out, print_message, print_table
from labapp.files.calibration_file import (
    CalibrationFile,
    CurveTable,
    MeasuredResponseTable,
    RegistrationTable,
    WavefrontTable,
    ZerothOrderTable,
)


@dataclass(frozen=True)
class CalibrationAdviceLimits:
    """Limits beyond which advice is given. All are chosen.

    rival_margin: least difference of the information criterion to a fit with another number of
        waves.
    phase_sigma: largest uncertainty of the phase response in radians.
    registration_px: largest uncertainty of the registration in pixels.
    blur_px: largest blur of the phase by neighbouring pixels, in panel pixels.
    shift_px: largest shift of the steered spots beside the zeroth order's map, in pixels.
    unmodulated: largest share of unmodulated light.
    focus_sigmas: focus error, in its standard deviations, from which it counts as real.
    """

    rival_margin: float = 10.0
    phase_sigma: float = 0.05
    registration_px: float = 0.2
    blur_px: float = 1.0
    shift_px: float = 1.0
    unmodulated: float = 0.15
    focus_sigmas: float = 3.0


_LIMITS = CalibrationAdviceLimits()

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
    for registration in file.registrations:
        found += _registration_rows(registration)
    for response in file.responses:
        found += _response_rows(response)
    for zeroth in file.zeroth:
        found.append(_zeroth_row(zeroth))
    if file.wavefront:
        found += _wavefront_rows(file.wavefront)
    return found


def _registration_rows(one: RegistrationTable) -> list[Row]:
    at = f"{one.wavelength_nm:g} nm"
    y, x = one.centre_px
    return [
        [
            f"registration, {at}",
            f"flip {one.flip}, turned {one.rotation_deg:+.3f}°, shear {one.shear:+.4f}",
            f"± {one.uncertainty_px:.3f} px in the worst corner",
            f"{one.spots} spots, residual {one.residual_px:.3f} px",
        ],
        [
            f"zeroth order, {at}",
            f"row {y:.2f}, column {x:.2f}",
            f"± {one.covariance_px2[0][0] ** 0.5:.3f} px",
            f"lever of {one.image_distance_mm:.2f} mm on the sensor by the scale",
        ],
    ]


def _response_rows(response: MeasuredResponseTable) -> list[Row]:
    found = []
    for number, curve in enumerate(response.curves):
        row, column = divmod(number, response.regions[1])
        reach = (curve.phase_rad[-1] - curve.phase_rad[0]) / math.pi
        found.append(
            [
                f"response, {response.wavelength_nm:g} nm, region {row + 1},{column + 1}",
                f"0 to {reach:.3f} π",
                f"± {max(curve.sigma_rad):.3f} rad at most",
                _sweep_words(curve),
            ]
        )
    return found


def _sweep_words(curve: CurveTable) -> str:
    left_out = f", {curve.outliers} left out" if curve.outliers else ""
    return f"{curve.frames} frames{left_out}, residual {100 * curve.residual:.2f} % of the swing"


def _zeroth_row(one: ZerothOrderTable) -> Row:
    return [
        f"unmodulated light, {one.wavelength_nm:g} nm",
        f"{100 * one.share:.2f} %",
        f"± {100 * one.sigma:.2f} %",
        f"{one.frames} gratings",
    ]


def _wavefront_rows(one: WavefrontTable) -> list[Row]:
    return [
        [
            f"wavefront, {one.wavelength_nm:g} nm",
            f"{one.rms_nm:.1f} nm rms",
            f"± {one.sigma_nm:.1f} nm",
            f"residual {100 * one.residual:.1f} % of the star's pictures",
        ],
        [
            "focus error",
            f"{one.focus_dioptres:+.4f} dioptres",
            f"± {one.focus_sigma_dioptres:.4f} dioptres",
            "the same pictures",
        ],
    ]


def advice(result: CalibrationResult) -> list[str]:
    """Return what to check or change at the bench, in sentences.

    The list is empty if all is good.
    """
    fits, file = result.fits, result.file
    return [
        *_registration_advice(file.registrations),
        *_response_advice(result),
        *_zeroth_advice(file.zeroth),
        *(_focus_advice(file.wavefront, fits.camera.ray_matrix_b) if file.wavefront else []),
    ]


def _registration_advice(tables: Sequence[RegistrationTable]) -> list[str]:
    said = []
    for one in tables:
        if one.outliers:
            said.append(
                f"{one.outliers} of {one.outliers + one.spots} spots at {one.wavelength_nm:g} nm "
                "were no spots of the panel: look for reflections and stray light."
            )
        if one.uncertainty_px > _LIMITS.registration_px:
            said.append(
                f"the registration is known to {one.uncertainty_px:.2f} px only: focus the star, "
                "expose it longer (--exposure-ms), or use a smaller pinhole."
            )
        if max(abs(s) for s in one.shift_px) > _LIMITS.shift_px:
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
            if fit.rival_margin < _LIMITS.rival_margin:
                said.append(
                    f"{where}: the count of waves is in doubt; sweep more levels (--levels)."
                )
            if float(fit.sigma.max()) > _LIMITS.phase_sigma:
                said.append(
                    f"{where}: the phase is known to {fit.sigma.max():.2f} rad only; brighten the "
                    "lamp, or choose fewer regions, so that their spots are brighter."
                )
            if fit.blur > _LIMITS.blur_px:
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


def _zeroth_advice(tables: Sequence[ZerothOrderTable]) -> list[str]:
    return [
        f"{100 * one.share:.0f} % of the light at {one.wavelength_nm:g} nm ignores the pattern: "
        "turn the polariser until the middle of a steered star is darkest."
        for one in tables
        if one.share > _LIMITS.unmodulated
    ]


def _focus_advice(one: WavefrontTable, lever: float) -> list[str]:
    if abs(one.focus_dioptres) < _LIMITS.focus_sigmas * one.focus_sigma_dioptres:
        return []
    shift = one.focus_dioptres * lever**2
    side = "away from" if shift > 0 else "towards"
    return [
        f"the star is {one.focus_dioptres:+.3f} dioptres out of focus. The calibration takes it "
        f"in; or move the sensor {abs(shift) * 1e3:.3f} mm {side} the lens, and calibrate again."
    ]
