"""An exposure for a level, and a proposed bracket, for light whose rates are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from labapp.window.engine.light_metering import SETTINGS, find_exposure, propose_exposures
from optics.camera import Sensor
from optics.hdr import ExposureLimits

SENSOR = Sensor(shape=(64, 96))
LIMITS = ExposureLimits(20e-6, SETTINGS.longest, readout=0.008)


class Scene:
    """A star on a dim field; frames have the sensor's noise. rate: electrons/s at its peak."""

    def __init__(self, rate, *, hot=0.0, step=1e-6, seed=3):
        y, x = np.indices(SENSOR.shape)
        self.rates = rate * (1e-3 + np.exp(-((y - 32) ** 2 + (x - 42) ** 2) / 8))
        self.rates[5, 5] += hot
        self.taken, self._step = [], step
        self._rng = np.random.default_rng(seed)

    def take(self, exposure):
        exposure = round(exposure / self._step) * self._step
        self.taken.append(exposure)
        light = self._rng.poisson((self.rates + SENSOR.dark_current) * exposure)
        electrons = light + self._rng.normal(0, SENSOR.read_noise, light.shape)
        numbers = np.rint(electrons / SENSOR.gain + SENSOR.black_level)
        return exposure, np.clip(numbers, 0, 2**SENSOR.bits - 1).astype(np.uint16)


@pytest.mark.parametrize("level", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("rate", [2e3, 1e5, 3e7])
@pytest.mark.parametrize("first", [20e-6, 0.01, 10.0])
def test_the_brightest_pixel_comes_to_its_level(rate, level, first):
    """From far too short and far too long first exposures alike."""
    scene = Scene(rate)
    found = find_exposure(scene.take, SENSOR, LIMITS, level, first)
    reached = rate * found.exposure / SENSOR.gain / (SENSOR.full_scale - SENSOR.black_level)
    # The brightest of some pixels is a little brighter than its mean, by its noise.
    assert reached == pytest.approx(level, rel=0.08)
    assert found.level == pytest.approx(level, rel=0.08)
    assert found.limit == ""
    assert found.frames == len(scene.taken) <= 14
    assert found.exposure == scene.taken[-1]


def test_a_hot_pixel_decides_nothing():
    found = find_exposure(Scene(1e5, hot=1e7).take, SENSOR, LIMITS, 0.6, 0.01)
    assert 1e5 * found.exposure == pytest.approx(
        0.6 * (SENSOR.full_scale - SENSOR.black_level) * SENSOR.gain, rel=0.08
    )


def test_a_camera_that_rounds_its_exposures_is_taken_at_its_word():
    found = find_exposure(Scene(1e5, step=1e-3).take, SENSOR, LIMITS, 0.5, 0.01)
    assert found.exposure * 1e3 == pytest.approx(round(found.exposure * 1e3))
    assert found.level == pytest.approx(0.5, rel=0.1)


def test_an_end_of_the_range_is_told_with_what_it_reaches():
    found = find_exposure(Scene(300).take, SENSOR, LIMITS, 0.9, 0.01)
    assert (found.exposure, found.limit) == (SETTINGS.longest, "longest")
    assert found.level == pytest.approx(
        300 * 10 / SENSOR.gain / (SENSOR.full_scale - SENSOR.black_level), rel=0.15
    )
    found = find_exposure(Scene(2e8).take, SENSOR, LIMITS, 0.1, 0.01)
    assert found.exposure == pytest.approx(20e-6)
    assert found.limit == "shortest"


@pytest.mark.parametrize(
    ("rate", "words"), [(1e10, "pixels are clipped in the shortest"), (0.0, "nothing is seen")]
)
@pytest.mark.parametrize("seed", range(10))
def test_light_beyond_the_camera_is_refused_with_the_remedy(rate, words, seed):
    with pytest.raises(ValueError, match=words):
        find_exposure(Scene(rate, seed=seed).take, SENSOR, LIMITS, 0.6, 0.01)


def test_a_level_is_a_share():
    with pytest.raises(ValueError, match="above 0 and below 1"):
        find_exposure(Scene(1e5).take, SENSOR, LIMITS, 1.2, 0.01)


def variance(rate, time, darks=4):
    """Of a rate that one frame of an exposure tells, in electrons²/s² (EMVA 1288)."""
    floor = SENSOR.read_noise**2 + SENSOR.gain**2 / 12 + SENSOR.dark_current * time
    return (rate * time + floor * (1 + 1 / darks)) / time**2


@pytest.mark.parametrize(("snr_db", "decades"), [(26.0, 2.0), (30.0, 3.0)])
def test_a_proposed_bracket_reaches_its_ratio(snr_db, decades):
    scene = Scene(1e6)
    found = propose_exposures(scene.take, SENSOR, LIMITS, snr_db, decades, 0.01)
    assert found.metered.high == pytest.approx(1e6, rel=0.1)
    assert found.metered.low == pytest.approx(found.metered.high / 10**decades)
    times = found.bracket.times
    assert list(times) == sorted(times)
    assert len(found.metered.times) == len(scene.taken)
    # At the dark end no exposure is clipped; frames of one exposure share their dark frames.
    low = found.metered.low
    full = (SENSOR.full_scale - SENSOR.black_level) * SENSOR.gain
    open_ = [time for time in times if low * time < 0.9 * full]
    told = sum(1 / variance(low, time, darks=4 / times.count(time)) for time in open_)
    assert 20 * math.log10(low * math.sqrt(told)) >= snr_db - 0.2
    assert found.seconds == pytest.approx(sum(times) + 0.008 * len(times))
    assert all(seconds >= found.seconds - 1e-9 for seconds in found.ladders.values())


def test_what_no_bracket_reaches_is_refused():
    few = replace(LIMITS, most_frames=2)
    with pytest.raises(ValueError, match="aren't reached"):
        propose_exposures(Scene(1e6).take, SENSOR, few, 40.0, 6.0, 0.01)
