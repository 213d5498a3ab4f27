"""Finding and focusing in the window: the whole way by clicks, and how well it is measured."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from figures import TOLD, Figure
from figures.walks import walk
from labapp.window.engine.light_metering import SETTINGS, find_exposure
from optics.camera import Sensor
from optics.hdr import ExposureLimits
from optics.measuring import focus_score, region_statistics, star_shape
from optics.measuring.region import Region

_WALK_GOAL, _WALK_LIMIT = 180.0, 600.0
_WIDTH_GOAL, _CASES, _SIDE = 0.02, 200, 96
_LEVEL, _LEVEL_GOAL = 0.6, 0.1
_TO_FWHM = 2 * math.sqrt(2 * math.log(2))
_SENSOR = Sensor()


def walk_figure(folder: Path) -> Iterator[Figure]:
    """On the virtual bench, in a window on an X server in memory, pixels and focus included."""
    name = "star found, focused, exposed, bracketed and restored, by clicks alone"
    goal = f"≤ {_WALK_GOAL / 60:g} min on the virtual bench"
    found = walk("aligning_walk.py", folder, _WALK_LIMIT)
    if isinstance(found, str):
        yield Figure(name, goal, found, None)
        return
    steps = found["seconds"]
    listed = ", ".join(
        f"{step} {steps[step]:.0f}" for step in sorted(steps, key=lambda one: steps[one])
    )
    yield Figure(
        name,
        goal,
        f"{steps['restored']:.0f} s ({listed}); FWHM {found['first_fwhm']:.2f} to "
        f"{found['fwhm']:.2f} pixels by {found['defocus']:.0f} nm of defocus on the panel, "
        f"residual {found['residual']:.2f} of the noise",
        steps["restored"] <= _WALK_GOAL,
    )


def measured_figures(folder: Path) -> Iterator[Figure]:
    """Stars and exposures whose truth is known, and the processor time of a measurement."""
    errors = np.array(list(_width_errors()))
    worst = float(np.quantile(errors, 0.95))
    yield Figure(
        "star FWHM of elliptical Gaussians, peak 10 to 90 % of full scale, σ 0.6 to 8 pixels",
        f"95 % of them within {100 * _WIDTH_GOAL:g} %",
        f"within {100 * worst:.2f} %, median {100 * float(np.median(errors)):.2f} %, of {_CASES}",
        worst <= _WIDTH_GOAL,
    )
    levels, frames = zip(*_exposures(), strict=True)
    off = max(abs(level / _LEVEL - 1) for level in levels)
    yield Figure(
        f"auto exposure of a star of 1e3 to 1e8 electrons/s to {100 * _LEVEL:g} % of full scale",
        f"within {100 * _LEVEL_GOAL:g} %",
        f"within {100 * off:.1f} %, {np.mean(frames):.1f} trial frames, {max(frames)} at most",
        off <= _LEVEL_GOAL,
    )
    yield Figure(
        "region, focus score and star in a picture of 5 megapixels, region of 96 x 96 pixels",
        TOLD,
        f"{1e3 * _seconds_each():.1f} ms of processor time a measurement",
        None,
    )


def _picture(rates: np.ndarray, exposure: float, rng: np.random.Generator) -> np.ndarray:
    """A frame of the sensor's own noise, rounded and clipped by its converter."""
    electrons = rng.poisson((rates + _SENSOR.dark_current) * exposure)
    numbers = (electrons + rng.normal(0, _SENSOR.read_noise, rates.shape)) / _SENSOR.gain
    return np.clip(np.rint(numbers + _SENSOR.black_level), 0, 4095).astype(np.uint16)


def _star(sigmas: tuple[float, float], place: tuple[float, float], angle: float) -> np.ndarray:
    """Of a peak of 1, sampled in the middle of the pixels."""
    y, x = np.indices((_SIDE, _SIDE))
    dy, dx = y - place[0], x - place[1]
    along = dx * math.cos(angle) + dy * math.sin(angle)
    beside = dy * math.cos(angle) - dx * math.sin(angle)
    light: np.ndarray = np.exp(-((along / sigmas[0]) ** 2 + (beside / sigmas[1]) ** 2) / 2)
    return light


def _width_errors() -> Iterator[float]:
    """The larger relative error of both widths, of random stars."""
    rng = np.random.default_rng(11)
    full = (_SENSOR.full_scale - _SENSOR.black_level) * _SENSOR.gain
    for _ in range(_CASES):
        major, minor = sorted(np.exp(rng.uniform(math.log(0.6), math.log(8), 2)), reverse=True)
        place = tuple(rng.uniform(40, 56, 2))
        light = _star((major, minor), (place[0], place[1]), rng.uniform(-1.5, 1.5))
        seen = star_shape(_picture(rng.uniform(0.1, 0.9) * full * light, 1.0, rng), _SENSOR)
        yield max(
            abs(seen.fwhm_major / (_TO_FWHM * major) - 1),
            abs(seen.fwhm_minor / (_TO_FWHM * minor) - 1),
        )


def _exposures() -> Iterator[tuple[float, int]]:
    """The level that the star's true peak has at the exposure that was found, and trial frames."""
    rng = np.random.default_rng(12)
    star = _star((2.0, 2.0), (48.0, 48.0), 0.0)
    limits = ExposureLimits(_SENSOR.exposure_range[0], SETTINGS.longest)
    full = (_SENSOR.full_scale - _SENSOR.black_level) * _SENSOR.gain
    for rate in np.geomspace(1e3, 1e8, 16):
        for first in (20e-6, 0.01, 10.0):
            found = find_exposure(
                lambda time, rate=rate: (time, _picture(rate * star, time, rng)),
                _SENSOR,
                limits,
                _LEVEL,
                first,
            )
            yield (rate + _SENSOR.dark_current) * found.exposure / full, found.frames


def _seconds_each() -> float:
    """Processor time of the three measurements, the median of some."""
    rng = np.random.default_rng(13)
    picture = rng.normal(70, 2, (2048, 2448)).astype(np.uint16)
    picture[:_SIDE, :_SIDE] = _picture(5e3 * _star((3.0, 3.0), (48.0, 48.0), 0.0), 1.0, rng)
    region, sensor = Region(0, 0, _SIDE, _SIDE), replace(_SENSOR, shape=picture.shape)
    spent = []
    for _ in range(15):
        began = time.process_time()
        region_statistics(picture, region, sensor.full_scale)
        focus_score(region.of(picture), sensor)
        star_shape(region.of(picture), sensor)
        spent.append(time.process_time() - began)
    return float(np.median(spent))


MEASUREMENTS = {"aligning": walk_figure, "alignment": measured_figures}
