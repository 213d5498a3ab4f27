"""Trial frames that find the exposure at which a flat target's light fills all pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.bench.opening import Bench
from labapp.calibration.camera.plan_design import CameraRequest
from labapp.calibration.exposure_search import limit_exposures, take_trials, trial_plan
from labapp.calibration.request import NEUTRAL_NAME
from labapp.common.errors import UserError
from labapp.files.quantities import round_exposure
from labapp.runs.acquisition.attendance import AskOperator
from labapp.runs.record.reader import Record
from optics.camera import Sensor
from optics.progress import Progress

_FIRST_MS, _RATIO = 16.0, 16.0
"""Middle exposure of the first trial in milliseconds, and ratio between a trial's exposures.
Chosen; one frame covers a range of about 50."""

_LOW, _HIGH = 0.02, 0.7
"""Shares of the converter's range between which a trial tells how bright the light is. Chosen."""

_BEYOND = 1.25
"""Longest exposure over that at which the dimmest pixels are full. Chosen: one exposure in five is
then saturated, and tells the clip level."""

_DIM_PERCENTILE = 0.5
"""Percentile of the pixels that counts as the dimmest, defective ones left out."""

_LEAST_EVEN = 0.25
"""Light of the dimmest pixels over that of the middle ones behind the same filter, below which a
target isn't evenly lit. Chosen: vignetting takes less."""

_MOST_ROUNDS = 5
"""Most rounds of trials. Chosen: they cover exposures from microseconds to minutes."""

_BENT = 0.9
"""Level over that which light would give without an end, below which pixels are full. Chosen."""


@dataclass(frozen=True)
class FlatTrial:
    """A trial frame of the flat target.

    exposure: seconds.
    middle, dimmest: numbers above black of the middle and the dimmest pixel.
    evenness: the dimmest over the middle pixel, the least behind any filter.
    """

    exposure: float
    middle: float
    dimmest: float
    evenness: float = 1.0


def find_longest_exposure(
    bench: Bench,
    request: CameraRequest,
    folder: Path,
    progress: Progress,
    ask: AskOperator | None,
) -> tuple[float, int]:
    """Find the exposure at which all pixels are full, in seconds, and the number of trial frames.

    Raises UserError if the target is too bright or too dim for the camera's exposures.
    """
    sensor = bench.description.sensor
    trials: list[FlatTrial] = []
    wanted = limit_exposures(sensor, [_FIRST_MS * 1e-3 * _RATIO**k for k in (-1, 0, 1)])
    for number in range(_MOST_ROUNDS):
        path = folder / f"trial-{number + 1}.h5"
        part = progress.part(number / _MOST_ROUNDS, (number + 1) / _MOST_ROUNDS)
        lit = {(request.flat, request.wavelength_nm): wanted}
        plan = trial_plan("Trial of the exposure that fills the pixels", NEUTRAL_NAME, lit)
        take_trials(bench, plan, path, part, ask)
        with Record(path) as record:
            for index, exposure in enumerate(record.column("exposure").tolist()):
                trials.append(_measure_trial(exposure, record.image(index), sensor))
        answer = judge_trials(trials, sensor)
        if isinstance(answer, float):
            progress.report(1.0, "exposure")
            return answer, len(trials)
        wanted = answer
    tried = ", ".join(f"{one.exposure * 1e3:g}" for one in trials)
    raise UserError(
        f"no exposure of {request.flat!r} is known to fill the pixels; tried {tried} ms. Check "
        "that the lamp is steady, or give --flat-ms."
    )


def _measure_trial(exposure: float, numbers: NDArray[np.uint16], sensor: Sensor) -> FlatTrial:
    """Measure a trial frame, behind each colour of filter."""
    pattern = sensor.colour.pattern if sensor.colour else ("M",)
    rows, columns = len(pattern), len(pattern[0])
    levels = [
        np.percentile(numbers[y::rows, x::columns], [_DIM_PERCENTILE, 50]) - sensor.black_level
        for y in range(rows)
        for x in range(columns)
    ]
    return FlatTrial(
        exposure,
        float(np.median(numbers)) - sensor.black_level,
        min(float(dim) for dim, _ in levels),
        min(float(dim / max(middle, 1.0)) for dim, middle in levels),
    )


def judge_trials(trials: list[FlatTrial], sensor: Sensor) -> float | tuple[float, ...]:
    """Derive the exposure that fills the pixels, or return those to try next, in seconds.

    Raises UserError at the end of what the camera can expose.
    """
    room = sensor.top_number - sensor.black_level
    fine = [one for one in trials if _LOW * room <= one.middle < _HIGH * room]
    if not fine:
        return _next_trials(trials, room, sensor)
    # Full pixels would make the light look dimmer than it is.
    best = max(fine, key=lambda one: one.middle / one.exposure)
    rate, dim_rate = (max(n, 1.0) / best.exposure for n in (best.middle, best.dimmest))
    # Wells may be full before the converter's range ends.
    full = [one for one in trials if one.middle < _BENT * rate * one.exposure]
    level = min(room, max((one.middle for one in full), default=room))
    if best.evenness < _LEAST_EVEN:
        raise UserError(
            f"the flat target is lit unevenly: its dimmest pixels have {best.evenness:.0%} of the "
            "light of the middle ones. Take a target without a picture, out of focus, and light it "
            "evenly, or name another with --flat."
        )
    if best.middle > _BENT * level:
        return (_require_possible(best.exposure / _RATIO, sensor),)
    longest = _BEYOND * level / dim_rate
    if full and max(one.exposure for one in full) >= longest / _BEYOND:
        return _require_possible(longest, sensor)
    return (_require_possible(longest, sensor),)


def _next_trials(trials: list[FlatTrial], room: float, sensor: Sensor) -> tuple[float, ...]:
    """Return the exposures to try next (seconds) where no trial tells the light."""
    bright = [one.exposure for one in trials if one.middle >= _HIGH * room]
    dark = [one.exposure for one in trials if one.middle < _LOW * room]
    if bright and dark:
        return limit_exposures(sensor, [math.sqrt(min(bright) * max(dark))])
    end, step = (min(bright), 1 / _RATIO) if bright else (max(dark), _RATIO)
    further = limit_exposures(sensor, [end * step, end * step**2])
    if all(math.isclose(one, end) for one in further):
        raise _end_of_range("bright" if bright else "dim", end)
    return further


def _require_possible(exposure: float, sensor: Sensor) -> float:
    """Return an exposure in whole microseconds; UserError if the camera can't expose so."""
    low, high = sensor.exposure_range
    if exposure > high:
        raise _end_of_range("dim", high)
    if exposure < low:
        raise _end_of_range("bright", low)
    return round_exposure(exposure)


def _end_of_range(trouble: str, end: float) -> UserError:
    """Return the error for a flat target that is too bright or too dim."""
    remedy = "Dim" if trouble == "bright" else "Brighten"
    other = ", or give --flat-ms: the full well then stays unknown" if trouble == "dim" else ""
    return UserError(
        f"the flat target is too {trouble} at {end * 1e3:g} ms, the end of what the camera can "
        f"expose. {remedy} the lamp, or check that the target is in the frame{other}."
    )
