"""Metering against scenes whose rates are known, on frames of numpy's own generator."""

import numpy as np
import pytest
from sweeps import some

from optics.camera import Sensor
from optics.hdr import ExposureLimits, Meter, scene_change, scene_light

SENSOR = Sensor()
LIMITS = ExposureLimits(20e-6, 30.0)


def frame(rate, time, rng):
    electrons = rng.poisson((rate + SENSOR.dark_current) * time) + rng.normal(0, 2.4, rate.shape)
    return np.clip(np.round(electrons / 2.6 + 64), 0, 4095)


def metered(rate, first=0.003, snr_db=30.0, decades=None, rng=None, limits=LIMITS):
    meter = Meter(SENSOR, limits, first, snr_db, decades)
    rng = rng or np.random.default_rng(0)
    while meter.next_time is not None:
        meter.add(meter.next_time, frame(rate, meter.next_time, rng))
    return meter.metered_range


@pytest.mark.parametrize(
    ("first", "low", "decades"),
    some(
        (
            (first, *scene)
            for first in (20e-6, 0.003, 10.0)
            for scene in ((30, 5), (1e3, 3), (1e4, 1))
        ),
        *(0, 4, 8),
    ),
)
def test_both_ends_of_a_scene_are_found_from_any_exposure(first, low, decades):
    rng = np.random.default_rng(int(low))
    rate = low * 10 ** rng.uniform(0, decades, (120, 160))
    found = metered(rate, first, rng=rng)
    # The brightest light is known roughly where nothing else follows from it, rather too high.
    assert 0.95 * rate.max() <= found.high <= 1.15 * rate.max()
    assert found.low == pytest.approx(np.quantile(rate, 0.01), rel=0.08)
    assert not found.is_noise_limited
    # A bracket of 30 dB takes 1000 electrons of the darkest pixels. Metering takes few of them, and
    # a part of the well of the brightest.
    assert sum(found.times[1:]) <= max(0.1 * 1000 / low, 0.25 * 10_400 / rate.max()) + first


def test_a_depth_below_the_brightest_needs_no_frame_for_the_dark_end():
    rate = 1e3 * 10 ** np.random.default_rng(1).uniform(0, 3, (120, 160))
    found = metered(rate, decades=5)
    assert found.low == pytest.approx(found.high / 1e5)
    assert found.high == pytest.approx(rate.max(), rel=0.07)
    assert sum(found.times) <= 0.1


def test_a_star_of_few_pixels_counts_and_hot_pixels_do_not():
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:96, :128]
    rate = 50 + 1e6 * np.exp(-((y - 40.3) ** 2 + (x - 70.6) ** 2) / (2 * 1.2**2))
    hot = rate.copy()
    hot[rng.integers(0, 96, 8), rng.integers(0, 50, 8)] += 1e7
    assert metered(hot, decades=4, rng=rng).high == pytest.approx(rate.max(), rel=0.1)


def test_darkness_is_not_taken_for_light():
    """Half of the pixels get 1e-3 electrons per second, which nothing tells."""
    rate = np.where(np.arange(160) < 80, 1e-3, 1e5) * np.ones((120, 1))
    found = metered(rate, limits=ExposureLimits(20e-6, 0.05))
    assert found.is_noise_limited
    # One electron per standard deviation of the noise without light, in 50 ms.
    assert found.low == pytest.approx(3.1 / 0.05, rel=0.2)


def test_too_much_and_too_little_light_are_told():
    with pytest.raises(ValueError, match="clipped in the shortest metering frame, of 1 ms"):
        metered(np.full((60, 80), 1e8), limits=ExposureLimits(1e-3, 1.0))
    with pytest.raises(ValueError, match="nothing is seen in the longest metering frame"):
        metered(np.full((60, 80), 1e-3), limits=ExposureLimits(1e-3, 0.01))
    with pytest.raises(ValueError, match="decades is 0"):
        Meter(SENSOR, LIMITS, 0.01, 30, decades=0)


def light(rate, time, rng):
    return scene_light([(time, frame(rate, time, rng))], SENSOR)


@pytest.mark.parametrize(("factor", "told"), [(1.2, True), (0.8, True), (1.05, False)])
@pytest.mark.parametrize("time", [2e-4, 0.004, 0.5])
def test_a_scene_of_other_light_is_told(factor, told, time):
    """In half a second most pixels are clipped, and some in each block; in .2 ms most are dark."""
    rng = np.random.default_rng(3)
    rate = 10 ** rng.uniform(3, 6, (96, 128))
    metered = scene_light([(t, frame(rate, t, rng)) for t in (5e-4, 0.02)], SENSOR)
    change = scene_change(metered, light(factor * rate, time, rng))
    assert change.ratio == pytest.approx(factor, rel=0.03)
    assert change.is_notable is told
    assert f"{change.ratio:.3g} times the light" in change.explain()


def test_a_part_that_moved_is_told_and_a_clipped_part_is_not_compared():
    rng = np.random.default_rng(4)
    rate = np.full((96, 128), 1e4)
    rate[:12, :16] = 1e7
    before = light(rate, 0.02, rng)
    assert np.isnan(before.blocks[0, 0])
    assert np.isfinite(before.blocks).sum() == 63
    moved = rate.copy()
    moved[48:, :48] *= 1.5
    assert scene_change(before, light(moved, 0.02, rng)).is_notable
    assert not scene_change(before, light(rate, 0.02, rng)).is_notable
    nothing = scene_change(before, light(0 * rate, 0.02, rng))
    assert nothing.parts == 0
    assert not nothing.is_notable


@pytest.mark.parametrize("share", [0.95, 0.99])
def test_light_that_nearly_clips_is_seen(share):
    """It lies within the noise of the clip level, and no pixel is clipped."""
    top = share * (4095 - 64) * 2.6
    found = metered(np.full((8, 8), 1e3) + (top / 0.01 - 1e3) * np.eye(8)[3], 0.01, decades=2)
    assert found.high == pytest.approx(top / 0.01, rel=0.05)
