"""What a camera is to be measured for, and the plan that takes pairs of flat and of dark frames."""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import Field

from labapp.calibration.plan_design import spread_order
from labapp.calibration.request import NEUTRAL_NAME
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.quantities import Amount, Nanometres, Positive, exposure_in_ms
from labapp.files.reading import FileModel, validate
from labapp.runs.record.reader import Record
from optics.camera import Sensor
from optics.measuring.paired_frames import MIN_EXPOSURES

_REQUEST_KEY = "camera_request"
"""Key of a plan's metadata under which the request is stored as JSON."""

_DARK_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Exposures of darkness alone, in shares of the longest: a line needs several. Chosen."""


class CameraRequest(FileModel):
    """Hold what a user asks a camera's calibration to measure.

    flat, dark: names of the targets. wavelength_nm: of the filter. exposures: number of exposure
    times of the light, by default as many as EMVA 1288 asks for. flat_ms: the longest, at which all
    pixels are full; found by trial if None. dark_s: longest exposure of darkness; by default a dark
    current of an electron per second shows to a percent on a megapixel. trials: trial frames that
    were taken.
    """

    flat: str = "flat"
    dark: str = "dark"
    wavelength_nm: Nanometres = 532.0
    exposures: Annotated[int, Field(ge=MIN_EXPOSURES, le=1000)] = 50
    flat_ms: Positive | None = None
    dark_s: Amount = 2.0
    trials: Annotated[int, Field(ge=0)] = 0


def camera_request_of(record: Record) -> CameraRequest | None:
    """Return the request that a record's plan carries; None for another plan's record."""
    text = record.plan.metadata.get(_REQUEST_KEY)
    if not isinstance(text, str):
        return None
    try:
        data = json.loads(text)
    except ValueError as error:
        raise UserError(
            f"{record.path}: its request is damaged: {error}. Run its plan again."
        ) from error
    return validate(data, CameraRequest, f"{record.path}: {_REQUEST_KEY}")


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
    return [evenly[n] for n in spread_order(count)]


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
            "metadata": {_REQUEST_KEY: request.model_dump_json()},
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
