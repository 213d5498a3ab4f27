"""Trial frames that find the exposure at which the neutral star is bright but unclipped."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.bench.opening import Bench
from labapp.calibration.request import NEUTRAL_NAME, CalibrationExposures, CalibrationRequest
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.quantities import exposure_in_ms, round_exposure
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import require_complete
from optics.camera import Camera, Sensor
from optics.measuring.spots import frame_variance, without_hot_pixels
from optics.progress import Progress

_FIRST_MS, _RATIO = 2.0, 16.0
"""Middle exposure of the first trial in milliseconds, and ratio between a trial's exposures.
Chosen; one frame covers a range of about 50."""

_STAR_LEVEL, _SWEEP_LEVEL, _CLIPPED = 0.6, 0.5, 0.97
"""Shares of the range from black level to full scale: what the brightest pixels of the neutral star
and of the sweep's spots shall reach, and from where the star counts as clipped. Chosen."""

_STAR_RADIUS = 8
"""Pixels from the brightest pixel within which the star's light falls. Chosen."""

_LEAST_SNR = 20.0
"""Least brightest pixel, over its noise, from which an exposure is derived. Chosen."""

_MOST_TRIALS = 4
"""Most rounds of trial exposures at a wavelength; chosen."""

_FIRST_ORDER = 4 / math.pi**2
"""Share of the light of binary stripes that goes into either first order."""


def limit_exposures(sensor: Sensor, wanted: Sequence[float]) -> tuple[float, ...]:
    """Limit exposures to the sensor's range, in whole microseconds.

    Exposures are in seconds; the result is sorted, and each is there once.
    """
    low, high = sensor.exposure_range
    return tuple(sorted({round_exposure(min(max(one, low), high)) for one in wanted}))


def trial_plan(
    title: str, neutral: str, wanted: Mapping[tuple[str, float], Sequence[float]]
) -> PlanFile:
    """Return the plan of trials through the neutral pattern.

    `neutral` is the pattern's name, and `wanted` has the exposures in seconds by target and
    wavelength in nm.
    """
    blocks = [
        {
            "targets": [target],
            "patterns": [neutral],
            "wavelengths_nm": [nm],
            "exposures_ms": [one * 1e3 for one in exposures],
        }
        for (target, nm), exposures in wanted.items()
    ]
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": title,
            "patterns": {neutral: {"kind": "constant", "grey": 0}},
            "acquire": blocks,
        }
    )


def take_trials(
    bench: Bench, plan: PlanFile, path: Path, progress: Progress, ask: AskOperator | None
) -> None:
    """Take the frames of a plan of trials, into a record that may be there already."""
    attendance = Attendance(progress=progress, ask=ask)
    require_complete(run_plan(bench, plan, path, attendance, source="trial", force=True))


@dataclass(frozen=True)
class TrialFrame:
    """A trial frame of the neutral star. exposure: seconds."""

    exposure: float
    image: NDArray[np.uint16]


def first_bracket(camera: Camera) -> tuple[float, ...]:
    """Return the first trial exposures in seconds, within the sensor's range."""
    middle = _FIRST_MS * 1e-3
    return limit_exposures(camera.sensor, [middle * _RATIO**k for k in (-1, 0, 1)])


@dataclass(frozen=True)
class StarExposure:
    """The exposure in seconds at which the neutral star is well exposed, and its width.

    width: in pixels, the square root of the star's light over that of its brightest pixel.
    """

    exposure: float
    width: float


def find_exposures(
    bench: Bench,
    request: CalibrationRequest,
    nm: float,
    folder: Path,
    progress: Progress,
    ask: AskOperator | None,
) -> CalibrationExposures:
    """Find the exposures at one wavelength by trial, unless the request gives one.

    Raises UserError if the star is too bright, too dim or unsteady.
    """
    camera = bench.description
    if request.exposure_ms is not None:
        return requested_exposures(camera, request, nm)
    trials: list[TrialFrame] = []
    wanted = first_bracket(camera)
    for number in range(_MOST_TRIALS):
        path = folder / f"trial-{nm:g}-{number + 1}.h5"
        part = progress.part(number / _MOST_TRIALS, (number + 1) / _MOST_TRIALS)
        title = f"Trial of the exposure, {nm:g} nm"
        plan = trial_plan(title, NEUTRAL_NAME, {(request.star, nm): wanted})
        take_trials(bench, plan, path, part, ask)
        with Record(path) as record:
            times = record.column("exposure").tolist()
            trials += [TrialFrame(time, record.image(index)) for index, time in enumerate(times)]
        answer = evaluate_trials(trials, camera)
        if isinstance(answer, StarExposure):
            progress.report(1.0, f"exposure, {nm:g} nm")
            return derive_exposures(camera, request, nm, answer, len(trials))
        wanted = answer
    tried = ", ".join(f"{trial.exposure * 1e3:g}" for trial in trials)
    raise UserError(
        f"no exposure of the neutral star is right at {nm:g} nm; tried {tried} ms. Check that the "
        "lamp is steady, or give --exposure-ms."
    )


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
        if peak >= _CLIPPED * room:
            longer = trial.exposure
        elif peak >= _LEAST_SNR * noise:
            exposure = trial.exposure * _STAR_LEVEL * room / peak
            return StarExposure(_clamp_exposure(exposure, sensor), width)
        elif longer is not None:
            return limit_exposures(sensor, [math.sqrt(longer * trial.exposure)])
        else:
            return _extend_bracket(trial.exposure, _RATIO, sensor)
    shortest = min(trial.exposure for trial in trials)
    return _extend_bracket(shortest, 1 / _RATIO, sensor)


def _measure_star(image: NDArray[np.uint16], sensor: Sensor) -> tuple[float, float, float]:
    """Measure a star's brightest pixel, noise and width (pixels) in a trial frame.

    The brightest pixel is measured above the background. Hot pixels are left out.
    """
    frame = image.astype(np.float64)
    variance = frame_variance(frame, sensor)
    light = without_hot_pixels(frame - np.median(frame), variance)
    y, x = np.unravel_index(int(np.argmax(light)), light.shape)
    around = (slice(max(n - _STAR_RADIUS, 0), n + _STAR_RADIUS + 1) for n in (y, x))
    part, peak = light[tuple(around)], float(light[y, x])
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
    lines = _diffraction_widths(camera, wavelength_nm)
    blur2 = max(found.width**2 - lines[0] * lines[1], 0.0)
    wide = [
        math.sqrt((line * count) ** 2 + blur2)
        for line, count in zip(lines, request.regions, strict=True)
    ]
    light = _FIRST_ORDER / math.prod(request.regions)
    dimmer = light * max(found.width**2, 1.0) / max(wide[0] * wide[1], 1.0)
    wanted = found.exposure * _SWEEP_LEVEL / _STAR_LEVEL / min(dimmer, 1.0)
    sweep = _clamp_exposure(wanted, camera.sensor)
    return CalibrationExposures(
        wavelength_nm=wavelength_nm,
        full_ms=exposure_in_ms(found.exposure),
        sweep_ms=exposure_in_ms(sweep),
        trials=trials,
    )


def _diffraction_widths(camera: Camera, wavelength_nm: float) -> list[float]:
    """Return the widths (y, x) of the whole panel's diffraction in sensor pixels."""
    scale = wavelength_nm * 1e-9 * camera.ray_matrix_b / camera.sensor.pitch
    return [scale / (n * camera.panel.pitch) for n in camera.panel.shape]


def requested_exposures(
    camera: Camera, request: CalibrationRequest, nm: float
) -> CalibrationExposures:
    """Derive the exposures from the requested one, with a star of the width of its diffraction."""
    assert request.exposure_ms is not None
    width = math.sqrt(math.prod(math.hypot(n, 1.0) for n in _diffraction_widths(camera, nm)))
    found = StarExposure(request.exposure_ms * 1e-3, width)
    return derive_exposures(camera, request, nm, found, 0)
