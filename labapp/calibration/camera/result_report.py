"""Results as tables, and advice on what to do at the bench."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from labapp.common.console import out, print_message, print_table
from labapp.files.camera_noise_file import CameraNoiseFile, QuantityTable

Row = list[str]


# Limits beyond which advice is given. All are chosen.
_CHI2 = (0.7, 1.4)  # reduced, between which points of the curve scatter as they should
_MOST_UNEVENNESS = 10.0  # percent of the brightest area over the dimmest, less 100
_MOST_JUMP = 1.0  # percent by which the light changes within a pair
_MOST_DRIFT = 2.0  # percent by which the light changes over the run
_MOST_LINEARITY_ERROR = 1.0  # percent

_LIMIT_WORDS = {"converter": "the converter's end", "well": "the wells' end", None: ""}


def camera_data(file: CameraNoiseFile, paths: tuple[Path, ...]) -> dict[str, Any]:
    """Return results, advice and paths as plain data."""
    return file.model_dump(mode="json") | {
        "advice": camera_advice(file),
        "files": [str(one) for one in paths],
    }


def print_camera(file: CameraNoiseFile, paths: tuple[Path, ...]) -> None:
    """Print results, defects, advice, and how to use the file."""
    print_table("Camera (EMVA 1288)", ["what", "found ", "± ", "unit", "how"], camera_rows(file))
    print_table("Defective pixels", ["kind", "pixels ", "criterion"], defect_rows(file))
    for line in camera_advice(file):
        print_message(line)
    for path in paths:
        out.print(f"wrote {path}", markup=False, soft_wrap=True)
    out.print("put it in force with a line in the bench file:")
    out.print(f'camera_calibration = "{paths[0]}"', markup=False, soft_wrap=True)


def camera_rows(file: CameraNoiseFile) -> list[Row]:
    """Return the printed rows of the results: name, value, uncertainty, unit, and how found."""
    noise = "temporal, rounding and dark current taken off"
    if file.read_noise_is_limit:
        noise = "at most: steps are too coarse to show it"
    clip = ""
    if file.clip_number_dn is not None:
        clip = f"{_LIMIT_WORDS[file.clip_limit]}, at {file.clip_number_dn.value:.5g} DN"
    curve = f"photon transfer, reduced χ² {file.reduced_chi2:.2f}, {file.degrees_of_freedom} d.o.f."
    listed: list[tuple[str, QuantityTable | None, str, str]] = [
        ("conversion gain 1/K", file.gain_electrons_per_dn, "e-/DN", curve),
        ("overall system gain K", file.system_gain_dn_per_electron, "DN/e-", "the same"),
        ("read noise", file.read_noise_electrons, "e-", noise),
        ("temporal dark noise", file.dark_noise_dn, "DN", "as the numbers show it"),
        ("black level", file.black_level_dn, "DN", "darkness at 0 s"),
        ("dark current", file.dark_current_electrons_per_s, "e-/s", "growth of darkness"),
        ("full well", file.full_well_electrons, "e-", clip or "no exposure was saturated"),
        ("saturation capacity", file.saturation_capacity_electrons, "e-", "largest variance"),
        ("sensitivity threshold", file.sensitivity_threshold_electrons, "e-", "SNR 1"),
        ("dynamic range", file.dynamic_range_db, "dB", "capacity over threshold, 20 log10"),
        ("SNR max", file.snr_max_db, "dB", "at the capacity, 20 log10"),
        ("linearity error", file.linearity_error_percent, "%", "mean, 5 to 95 % of saturation"),
        ("PRNU1288", file.prnu_percent, "%", "without slow changes and defects"),
        ("DSNU1288", file.dsnu_electrons, "e-", "without defects"),
        ("drift of the lamp", file.lamp_drift_percent, "%", "first to last exposure"),
    ]
    return [[name, *_number(one), unit, how] for name, one, unit, how in listed]


def _number(one: QuantityTable | None) -> list[str]:
    """Format a quantity with two digits of its uncertainty."""
    if one is None:
        return ["unknown", ""]
    if not one.sigma > 0:
        return [f"{one.value:g}", ""]
    decimals = max(0, 1 - math.floor(math.log10(one.sigma)))
    return [f"{one.value:.{decimals}f}", f"{one.sigma:.{decimals}f}"]


def defect_rows(file: CameraNoiseFile) -> list[Row]:
    """Return the printed rows on defective pixels, with their criteria."""
    found = file.defects
    hot = (
        f"dark signal ± {found.hot_electrons:.3g} e- or dark current + "
        f"{found.hot_electrons_per_s:.3g} e-/s off the median"
    )
    off = f"{found.response_percent:g} %"
    return [
        ["hot, by dark signal", str(len(found.hot)), hot],
        ["hot, by photo-response", str(len(found.bright)), f"{off} above the pixels around"],
        ["weak", str(len(found.weak)), f"{off} below the pixels around"],
        ["dead", str(len(found.dead)), f"below {found.dead_percent:g} % of the pixels around"],
    ]


def camera_advice(file: CameraNoiseFile) -> list[str]:
    """Return what to do at the bench, in sentences: on the camera's settings, then on the light."""
    said, (low, high) = [], _CHI2
    if file.reduced_chi2 > high:
        said.append(
            f"variances scatter more than photons make them (χ² {file.reduced_chi2:.2f}): check "
            "that frames are raw, without gamma, sharpening or automatic gain, and that the light "
            "doesn't move."
        )
    elif file.reduced_chi2 < low:
        said.append(
            f"variances scatter less than photons make them (χ² {file.reduced_chi2:.2f}): check "
            "that frames are raw, without noise reduction, binning or compression."
        )
    if file.full_well_electrons is None:
        said.append(
            "no exposure was saturated, and full well, capacity and dynamic range are unknown: "
            "expose longer (--flat-ms)."
        )
    if file.read_noise_is_limit:
        said.append(
            "the read noise is less than the converter's steps show: choose more bits or a higher "
            "analogue gain, if the camera has them."
        )
    error = file.linearity_error_percent
    if error is not None and error.value > _MOST_LINEARITY_ERROR:
        said.append(
            f"the signal is {error.value:.2g} % off a line on average: check that gamma is 1 and "
            "that the light is steady, or keep pixels below the bend."
        )
    current = file.dark_current_electrons_per_s
    if current.sigma > max(abs(current.value), 0.0):
        said.append(
            f"the dark current is known to {current.sigma:.2g} e-/s only: take longer darkness "
            "(--dark-s)."
        )
    if file.light_unevenness_percent > _MOST_UNEVENNESS:
        said.append(
            f"the light differs by {file.light_unevenness_percent:.0f} % over the sensor: "
            "saturation capacity and PRNU are less sure; defocus the target, or light it evenly."
        )
    if file.lamp_jump_percent > _MOST_JUMP:
        said.append(
            f"the light changed by up to {file.lamp_jump_percent:.1f} % within a pair: the gain "
            "allows for it, the linearity doesn't; use a steady lamp, or whole periods of it."
        )
    drift = file.lamp_drift_percent
    if drift is not None and abs(drift.value) > _MOST_DRIFT:
        said.append(
            f"the lamp drifted by {drift.value:+.1f} % during the run, which is allowed for: let "
            "it warm up."
        )
    return said
