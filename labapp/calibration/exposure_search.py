"""Trial frames that find the exposure at which the neutral star is bright but unclipped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labapp.calibration.request import CalibrationExposures, CalibrationRequest
from labapp.calibration.trial_exposures import limit_exposures
from labapp.common.errors import UserError
from labapp.files.quantities import exposure_in_ms
from optics.camera import Camera, Sensor
from optics.measuring.spots import frame_variance, without_hot_pixels


@dataclass(frozen=True)
class ExposureSearchSettings:
    """Tune the search for exposures. Levels are shares of the range from black level to full scale.

    first_ms: middle exposure of the first trial in milliseconds. Chosen.
    bracket_ratio: between the exposures of a trial. One frame covers a range of about 50.
    star_level: level that the brightest pixel of the neutral star shall reach. Chosen.
    sweep_level: level that the brightest pixel of the sweep's spots shall reach. Chosen.
    clipping_level: level above which a pixel of the star counts as clipped. Chosen.
    star_radius: pixels from the brightest pixel within which the star's light falls. Chosen.
    min_peak_snr: least ratio of the brightest pixel to its noise for which an exposure is derived.
        Chosen.
    """

    first_ms: float = 2.0
    bracket_ratio: float = 16.0
    star_level: float = 0.6
    sweep_level: float = 0.5
    clipping_level: float = 0.97
    star_radius: int = 8
    min_peak_snr: float = 20.0


_SETTINGS = ExposureSearchSettings()

_FIRST_ORDER = 4 / math.pi**2
"""Share of the light of binary stripes that goes into either first order."""


@dataclass(frozen=True)
class TrialFrame:
    """A trial frame of the neutral star. exposure: seconds."""

    exposure: float
    image: NDArray[np.uint16]


def first_bracket(camera: Camera) -> tuple[float, ...]:
    """Return the first trial exposures in seconds, within the sensor's range."""
    middle, ratio = _SETTINGS.first_ms * 1e-3, _SETTINGS.bracket_ratio
    return limit_exposures(camera.sensor, [middle * ratio**k for k in (-1, 0, 1)])


@dataclass(frozen=True)
class StarExposure:
    """The exposure in seconds at which the neutral star is well exposed, and its width.

    width: in pixels, the square root of the star's light over that of its brightest pixel.
    """

    exposure: float
    width: float


def evaluate_trials(
    trials: Sequence[TrialFrame], camera: Camera
) -> StarExposure | tuple[float, ...]:
    """Derive the star's exposure from trials, or return the next exposures in seconds.

    Raises UserError if the star is too bright or too dim for the camera.
    """
    sensor = camera.sensor
    room = sensor.full_scale - sensor.black_level
    longer = None
    for trial in sorted(trials, key=lambda trial: -trial.exposure):
        peak, noise, width = _measure_star(trial.image, sensor)
        if peak >= _SETTINGS.clipping_level * room:
            longer = trial.exposure
        elif peak >= _SETTINGS.min_peak_snr * noise:
            exposure = trial.exposure * _SETTINGS.star_level * room / peak
            return StarExposure(_clamp_exposure(exposure, sensor), width)
        elif longer is not None:
            return limit_exposures(sensor, [math.sqrt(longer * trial.exposure)])
        else:
            return _extend_bracket(trial.exposure, _SETTINGS.bracket_ratio, sensor)
    shortest = min(trial.exposure for trial in trials)
    return _extend_bracket(shortest, 1 / _SETTINGS.bracket_ratio, sensor)


def _measure_star(image: NDArray[np.uint16], sensor: Sensor) -> tuple[float, float, float]:
    """Measure a star's brightest pixel, noise and width (pixels) in a trial frame.

    The brightest pixel is measured above the background. Hot pixels are left out.
    """
    frame = image.astype(np.float64)
    variance = frame_variance(frame, sensor)
    light = without_hot_pixels(frame - np.median(frame), variance)
    y, x = np.unravel_index(int(np.argmax(light)), light.shape)
    radius = _SETTINGS.star_radius
    part = light[
        max(y - radius, 0) : y + radius + 1,
        max(x - radius, 0) : x + radius + 1,
    ]
    peak = float(light[y, x])
    width = math.sqrt(max(float(part.sum()) / peak, 1.0)) if peak > 0 else 1.0
    return peak, math.sqrt(float(np.median(variance))), width


def _extend_bracket(exposure: float, step: float, sensor: Sensor) -> tuple[float, ...]:
    """Return the next trial exposures in seconds; UserError at the camera's limit.

    They are longer than `exposure` if `step` is above 1, and shorter if it is below 1.
    """
    further = limit_exposures(sensor, [exposure * step, exposure * step**2])
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
    """Derive all exposures at a wavelength from the exposure of the neutral star.

    The sweep's exposure is for the spot of one region. This spot gets the region's share of the
    light in one first order. It is wider than the star by the diffraction at the region.
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
    wanted = found.exposure * _SETTINGS.sweep_level / _SETTINGS.star_level / min(dimmer, 1.0)
    sweep = _clamp_exposure(wanted, sensor)
    return CalibrationExposures(
        wavelength_nm=wavelength_nm,
        full_ms=exposure_in_ms(found.exposure),
        sweep_ms=exposure_in_ms(sweep),
        trials=trials,
    )


def nominal_star_width(camera: Camera, wavelength_nm: float) -> float:
    """Estimate the star's width in pixels from the diffraction and the pixel size."""
    scale = wavelength_nm * 1e-9 * camera.ray_matrix_b / camera.sensor.pitch
    lines = [scale / (n * camera.panel.pitch) for n in camera.panel.shape]
    return math.sqrt(math.prod(math.hypot(line, 1.0) for line in lines))
