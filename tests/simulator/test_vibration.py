"""Vibration of the image against a sum of moved pictures, and the time that it needs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from optical_situations import CAMERA, STAR, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera
from simulator.effects.picture_norms import minimum_norms
from simulator.effects.time_effects import Vibration
from simulator.formation.mean_picture import image_vibration
from simulator.imaging import Imaging

CACHE = ByteCache()
SHAKEN = replace(CAMERA, vibration=12e-6)


def star(camera: Camera, y: float, x: float, on: int, **more) -> np.ndarray:
    """With its image so many metres beside the place of the others."""
    scale = camera.magnification(1.0)
    moved = replace(STAR, offset=(STAR.offset[0] + y / scale, STAR.offset[1] + x / scale))
    s = situation(moved, camera, **more)
    levels = {"diffraction": 1, "light sampling": 1, "vibration": on}
    return rendered(s, levels, CACHE)


def test_a_trembling_star_is_the_mean_of_stars_at_all_its_places():
    """By Gauss and Hermite's rule, over places that are normally distributed."""
    at, weight = np.polynomial.hermite_e.hermegauss(7)
    weight = weight / weight.sum()
    wanted = sum(
        u * v * star(CAMERA, SHAKEN.vibration * y, SHAKEN.vibration * x, 0)
        for y, u in zip(at, weight, strict=True)
        for x, v in zip(at, weight, strict=True)
    )
    found, still = (star(SHAKEN, 0, 0, on) for on in (1, 0))
    assert np.linalg.norm(still - wanted) > 0.1 * np.linalg.norm(wanted)
    assert np.linalg.norm(found - wanted) <= 2e-3 * np.linalg.norm(wanted)
    s = situation(STAR, SHAKEN)
    change = np.linalg.norm(found - still)
    assert change <= Vibration().error_bound(s, 0).mean
    assert minimum_norms(s).mean <= np.linalg.norm(found)


@pytest.mark.parametrize("periods", [0.05, 0.4, 1.0, 7.3])
def test_a_short_exposure_sees_part_of_it(periods):
    """The variance of a sine of any phase about its mean in the exposure, by sums."""
    shaken = replace(SHAKEN, vibration_frequency=50.0)
    t = (np.arange(2000) + 0.5) / 2000 * periods
    phase = (np.arange(200) + 0.5) / 200
    place = math.sqrt(2) * np.sin(2 * np.pi * (t + phase[:, None]))
    rms = math.sqrt(float(place.var(axis=1).mean()))
    s = situation(STAR, shaken, exposure=periods / 50)
    assert image_vibration(s) == pytest.approx(12e-6 * rms, rel=1e-3)


def test_exposures_of_one_simulator_are_blurred_by_their_own_time():
    shaken, imaging = replace(SHAKEN, vibration_frequency=20.0), Imaging(1e-3)
    peaks = []
    for exposure in (1e-3, 1e-1):
        s = situation(STAR, shaken, exposure=exposure)
        peaks.append(float(imaging.electrons(s, imaging.plan(s).recipe).max()) / exposure)
    assert peaks[1] < 0.9 * peaks[0]


def test_a_still_camera_has_none():
    assert not Vibration().is_present(situation())
    assert image_vibration(situation()) == 0


@pytest.mark.parametrize(
    "data", [{"vibration": -1e-6}, {"vibration": math.nan}, {"vibration_frequency": 0.0}]
)
def test_data_that_cannot_be_are_refused(data):
    with pytest.raises(ValueError, match=next(iter(data))):
        Camera(**data)
