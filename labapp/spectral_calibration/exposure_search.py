"""Trial frames that find exposures at which star and white sheet are bright but unclipped."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labapp.bench.opening import Bench
from labapp.calibration.exposure_search import limit_exposures, trial_plan
from labapp.common.errors import UserError
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import require_complete
from labapp.spectral_calibration.request import SpectraRequest
from optics.camera import Sensor
from optics.progress import Progress

# Middle exposure of the first trial in milliseconds, and ratio between its exposures. Chosen as
# between those of the plan coded-snapshot; one frame covers a range of about 50.
_FIRST_MS, _RATIO = 16.0, 16.0

# Level, 0 at black and 1 at full scale, that the brightest pixel shall reach, and from which it
# counts as clipped. Chosen.
_LEVEL, _CLIPPED = 0.6, 0.97

_LEAST_LEVEL = 0.01  # of the brightest pixel, to derive an exposure: with 12 bits, 40 steps
_MOST_ROUNDS = 4  # of trials; chosen: they cover exposures from microseconds to minutes
_BRIGHT_PERCENTILE = 99.5  # of a white sheet's pixels; counts as its brightest, hot ones left out

Exposures = dict[tuple[str, float], float]
"""Exposures in seconds by target and wavelength in nm."""


@dataclass(frozen=True)
class _Trial:
    """Exposure of a trial frame in seconds, and the level of its brightest pixel, 0 to 1."""

    exposure: float
    level: float


def find_exposures(
    bench: Bench,
    request: SpectraRequest,
    folder: Path,
    progress: Progress,
    ask: AskOperator | None,
) -> Exposures:
    """Find the exposures of star and white sheet in each band.

    Both are photographed through the neutral pattern, all bands in one run; those that were all
    clipped or all dark are taken again. Exposures that the request states aren't looked for.
    Raises UserError if one can't be found.
    """
    found: Exposures = {}
    tried: dict[tuple[str, float], list[_Trial]] = {}
    stated = {request.star: request.exposure_ms, request.flat: request.flat_ms}
    for target, ms in stated.items():
        for nm in request.bands_nm:
            if ms is None:
                tried[target, nm] = []
            else:
                found[target, nm] = ms * 1e-3
    sensor = bench.description.sensor
    wanted = {one: limit_exposures(sensor, [_FIRST_MS * 1e-3 * _RATIO**k for k in (-1, 0, 1)])
              for one in tried}  # fmt: skip
    for number in range(_MOST_ROUNDS):
        if not wanted:
            return found
        part = progress.part(number / _MOST_ROUNDS, (number + 1) / _MOST_ROUNDS)
        path = folder / f"trial-{number + 1}.h5"
        title = "Trial of the exposures of a spectral calibration"
        plan = trial_plan(title, request.neutral, wanted)
        outcome = run_plan(
            bench, plan, path, Attendance(progress=part, ask=ask), source="trial", force=True
        )
        require_complete(outcome)
        _read_trials(path, tried, request.star)
        asked, wanted = tuple(wanted), {}
        for key in asked:
            exposure, more = _judge(tried[key], sensor)
            if exposure is not None:
                found[key] = exposure
            elif more:
                wanted[key] = more
            else:
                raise _out_of_reach(key, tried[key])
    if wanted:
        target, nm = next(iter(wanted))
        shown = ", ".join(f"{one.exposure * 1e3:g}" for one in tried[target, nm])
        raise UserError(
            f"no exposure of {target!r} is right at {nm:g} nm; tried {shown} ms. Check that the "
            "lamp is steady, or give --exposure-ms and --flat-ms."
        )
    return found


def _read_trials(path: Path, tried: dict[tuple[str, float], list[_Trial]], star: str) -> None:
    """Add the frames of a trial's record to those that were tried."""
    with Record(path) as record:
        sensor = record.camera.sensor
        room = sensor.full_scale - sensor.black_level
        columns = {name: record.column(name) for name in ("target", "wavelength_asked", "exposure")}
        for index in range(record.frame_count):
            target = record.target_names[columns["target"][index]]
            nm = columns["wavelength_asked"][index] * 1e9
            key = next(one for one in tried if one[0] == target and abs(one[1] - nm) < 1e-3)
            frame = record.image(index)
            # Behind colour filters, a star's brightest pixel may have no bright neighbour.
            if target == star:
                bright = float((frame - np.median(frame)).max())
            else:
                bright = float(np.percentile(frame, _BRIGHT_PERCENTILE)) - sensor.black_level
            tried[key].append(_Trial(float(columns["exposure"][index]), bright / room))


def _out_of_reach(key: tuple[str, float], trials: list[_Trial]) -> UserError:
    """Return the error of a target and wavelength in nm that no exposure of the camera suits."""
    end = min(trials, key=lambda one: one.level).exposure
    dim = max(one.level for one in trials) < _LEAST_LEVEL
    return UserError(
        f"{key[0]!r} is too {'dim' if dim else 'bright'} at {key[1]:g} nm, at {end * 1e3:g}"
        f" ms, the end of what the camera can expose. {'Brighten' if dim else 'Dim'} the "
        "lamp, or check that it is in the frame."
    )


def _judge(trials: list[_Trial], sensor: Sensor) -> tuple[float | None, tuple[float, ...]]:
    """Return the exposure that trials show in seconds, or those to try next.

    Neither is known at the end of what the camera can expose.
    """
    fine = [one for one in trials if _LEAST_LEVEL <= one.level < _CLIPPED]
    if fine:
        best = max(fine, key=lambda one: one.level)
        return limit_exposures(sensor, [best.exposure * _LEVEL / best.level])[0], ()
    bright = [one.exposure for one in trials if one.level >= _CLIPPED]
    dark = [one.exposure for one in trials if one.level < _LEAST_LEVEL]
    if bright and dark:
        return None, limit_exposures(sensor, [math.sqrt(min(bright) * max(dark))])
    end = min(bright) if bright else max(dark)
    step = 1 / _RATIO if bright else _RATIO
    further = limit_exposures(sensor, [end * step, end * step**2])
    return None, tuple(one for one in further if not math.isclose(one, end))
