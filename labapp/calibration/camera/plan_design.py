"""The plan that takes pairs of flat and of dark frames."""

from __future__ import annotations

import math
from typing import Any

from labapp.calibration.camera.request import NEUTRAL_NAME, REQUEST_KEY, CameraRequest
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.quantities import exposure_in_ms
from optics.camera import Sensor

_DARK_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Exposures of darkness alone, in shares of the longest: a line needs several. Chosen."""

_GOLDEN = 0.382
"""Share of all exposures between one and the next: a lamp's drift isn't taken for a bend then."""


def light_exposures(request: CameraRequest, sensor: Sensor) -> list[float]:
    """Return the exposure times of the light in ms, evenly up to the longest.

    They are in the order in which they are taken. Raises UserError if the camera can't expose so
    many different times.
    """
    assert request.flat_ms is not None
    count, longest = request.exposures, request.flat_ms
    low, high = (1e3 * one for one in sensor.exposure_range)
    shortest = longest / count
    if not low <= shortest or longest > high:
        remedy = "shorter" if longest > high else "longer"
        raise UserError(
            f"{count} exposures from {shortest:g} to {longest:g} ms: the camera exposes {low:g} to "
            f"{high:g} ms. Give a {remedy} --flat-ms and light that is "
            f"{'brighter' if longest > high else 'dimmer'}, or fewer --exposures."
        )
    evenly = [round(longest * 1e3 * (n + 1) / count) / 1e3 for n in range(count)]
    if len(set(evenly)) < count:
        raise UserError(
            f"{count} exposures up to {longest:g} ms are less than a microsecond apart. Dim the "
            "light, or give fewer --exposures."
        )
    stride = max(1, round(_GOLDEN * count))
    while math.gcd(stride, count) > 1:
        stride += 1
    return [evenly[n * stride % count] for n in range(count)]


def build_camera_plan(request: CameraRequest, sensor: Sensor) -> PlanFile:
    """Build the plan that takes all frames.

    Darkness comes first, so that targets are changed once. Raises UserError as light_exposures().
    """
    light = light_exposures(request, sensor)
    high = sensor.exposure_range[1]
    longer = {exposure_in_ms(min(request.dark_s, high) * share) for share in _DARK_SHARES}
    dark = sorted({*light, *(one for one in longer if one > max(light))})
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Calibration of the camera",
            "metadata": {REQUEST_KEY: request.model_dump_json()},
            "patterns": {NEUTRAL_NAME: {"kind": "constant", "grey": 0}},
            "acquire": [
                _block(request.dark, "dark", request.wavelength_nm, dark),
                _block(request.flat, "flat", request.wavelength_nm, light),
            ],
        }
    )


def _block(target: str, role: str, nm: float, exposures: list[float]) -> dict[str, Any]:
    return {
        "targets": [target],
        "patterns": [NEUTRAL_NAME],
        "wavelengths_nm": [nm],
        "exposures_ms": exposures,
        "repeats": 2,
        "role": role,
    }
