"""The exposure at which the neutral star is bright and not clipped, found by a few trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labapp.calibration import request as names
from labapp.calibration.request import CalibrationExposures, CalibrationRequest
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from optics.calibration.spots import frame_variance, without_hot_pixels
from optics.camera import Camera, Sensor

_FIRST_MS = 2.0
_BRACKET_RATIO = 16.0
"""Between the exposures of a trial: a frame measures a range of some fifty."""

_STAR_LEVEL, _SWEEP_LEVEL = 0.6, 0.5
"""Of the range from black to full scale, that the brightest pixel shall reach."""

_CLIPPING_LEVEL = 0.97
"""Of that range, from which a star's pixel counts as clipped."""

_STAR_RADIUS = 8
"""Pixels around the brightest one that the star's light falls on."""

_MIN_PEAK_SNR = 20.0
"""Times its noise that the brightest pixel must have, to set an exposure by."""

_FIRST_ORDER = 4 / math.pi**2
"""Of the light of stripes, in either first order."""


@dataclass(frozen=True)
class TrialFrame:
    """A frame of the neutral star. exposure: seconds."""

    exposure: float
    image: NDArray[np.uint16]


def first_bracket(camera: Camera) -> tuple[float, ...]:
    """Exposures of a first trial in seconds, within the sensor's range."""
    return _bracket(camera.sensor, [_FIRST_MS * 1e-3 * _BRACKET_RATIO**k for k in (-1, 0, 1)])


def _bracket(sensor: Sensor, wanted: list[float]) -> tuple[float, ...]:
    low, high = sensor.exposure_range
    return tuple(sorted({round(min(max(t, low), high) * 1e6) / 1e6 for t in wanted}))


def trial_plan(
    request: CalibrationRequest, wavelength_nm: float, exposures: tuple[float, ...]
) -> PlanFile:
    """The neutral star at one wavelength, at several exposures in seconds."""
    block = {
        "targets": [request.star],
        "patterns": [names.NEUTRAL_NAME],
        "wavelengths_nm": [wavelength_nm],
        "exposures_ms": [t * 1e3 for t in exposures],
    }
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": f"Trial of the exposure, {wavelength_nm:g} nm",
            "patterns": {names.NEUTRAL_NAME: {"kind": "constant", "grey": 0}},
            "acquire": [block],
        }
    )


@dataclass(frozen=True)
class StarExposure:
    """exposure: seconds at which the neutral star is well exposed. width: the square root of its
    light over its brightest pixel, in pixels: how wide it is."""

    exposure: float
    width: float


def evaluate_trials(
    trials: Sequence[TrialFrame], camera: Camera
) -> StarExposure | tuple[float, ...]:
    """What the trials tell, or the exposures in seconds that must be tried next.

    UserError if the star is too bright or too dim for the camera.
    """
    sensor = camera.sensor
    room = sensor.full_scale - sensor.black_level
    longer = None
    for trial in sorted(trials, key=lambda trial: -trial.exposure):
        peak, noise, width = _measure_star(trial.image, sensor)
        if peak >= _CLIPPING_LEVEL * room:
            longer = trial.exposure
        elif peak >= _MIN_PEAK_SNR * noise:
            return StarExposure(
                _clamp_exposure(trial.exposure * _STAR_LEVEL * room / peak, sensor), width
            )
        elif longer is not None:
            return _bracket(sensor, [math.sqrt(longer * trial.exposure)])
        else:
            return _extend_bracket(trial.exposure, _BRACKET_RATIO, sensor)
    return _extend_bracket(min(trial.exposure for trial in trials), 1 / _BRACKET_RATIO, sensor)


def _measure_star(image: NDArray[np.uint16], sensor: Sensor) -> tuple[float, float, float]:
    """The star's brightest pixel above the background, the noise, and the star's width; hot
    pixels left out."""
    frame = image.astype(np.float64)
    variance = frame_variance(frame, sensor)
    light = without_hot_pixels(frame - np.median(frame), variance)
    y, x = np.unravel_index(int(np.argmax(light)), light.shape)
    part = light[
        max(y - _STAR_RADIUS, 0) : y + _STAR_RADIUS + 1,
        max(x - _STAR_RADIUS, 0) : x + _STAR_RADIUS + 1,
    ]
    peak = float(light[y, x])
    width = math.sqrt(max(float(part.sum()) / peak, 1.0)) if peak > 0 else 1.0
    return peak, math.sqrt(float(np.median(variance))), width


def _extend_bracket(exposure: float, step: float, sensor: Sensor) -> tuple[float, ...]:
    """The next exposures on one side; UserError at the end of the camera's range."""
    further = _bracket(sensor, [exposure * step, exposure * step**2])
    if further[0] == exposure or further[-1] == exposure:
        trouble, remedy = ("dim", "Brighten") if step > 1 else ("bright", "Dim")
        raise UserError(
            f"the neutral star is too {trouble} at {exposure * 1e3:g} ms, the end of what the "
            f"camera can expose. {remedy} the lamp, check that the star is in the frame, or give "
            "--exposure-ms."
        )
    return further


def _clamp_exposure(exposure: float, sensor: Sensor) -> float:
    low, high = sensor.exposure_range
    return min(max(exposure, low), high)


def derive_exposures(
    camera: Camera,
    request: CalibrationRequest,
    wavelength_nm: float,
    found: StarExposure,
    trials: int,
) -> CalibrationExposures:
    """From the neutral star to the regions' spots.

    A region's spot has its share of the light in its own first order, and is wider than the star
    by the region's own diffraction.
    """
    panel, sensor = camera.panel, camera.sensor
    scale = wavelength_nm * 1e-9 * camera.ray_matrix_b / sensor.pitch
    lines = [scale / (n * panel.pitch) for n in panel.shape]
    blur2 = max(found.width**2 - lines[0] * lines[1], 0.0)
    wide = [
        math.sqrt((line * count) ** 2 + blur2)
        for line, count in zip(lines, request.regions, strict=True)
    ]
    light = _FIRST_ORDER / math.prod(request.regions)
    dimmer = light * max(found.width**2, 1.0) / max(wide[0] * wide[1], 1.0)
    sweep = _clamp_exposure(found.exposure * _SWEEP_LEVEL / _STAR_LEVEL / min(dimmer, 1.0), sensor)
    return CalibrationExposures(
        wavelength_nm=wavelength_nm,
        full_ms=_milliseconds(found.exposure),
        sweep_ms=_milliseconds(sweep),
        trials=trials,
    )


def nominal_star_width(camera: Camera, wavelength_nm: float) -> float:
    """The same from the camera's description: the pupil's diffraction and a pixel."""
    scale = wavelength_nm * 1e-9 * camera.ray_matrix_b / camera.sensor.pitch
    lines = [scale / (n * camera.panel.pitch) for n in camera.panel.shape]
    return math.sqrt(math.prod(math.hypot(line, 1.0) for line in lines))


def _milliseconds(seconds: float) -> float:
    """Whole microseconds, as cameras count."""
    return round(seconds * 1e6) / 1e3
