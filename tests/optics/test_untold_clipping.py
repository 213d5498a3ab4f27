"""Metering of cameras of which nobody told where their pixels clip."""

import numpy as np
import pytest
from sweeps import some

from optics.camera import Sensor
from optics.hdr import ExposureLimits, Meter

SHAPE = (60, 80)
LIMITS = ExposureLimits(20e-6, 5.0)


def metered(rate, top, first, seed, limits=LIMITS, bits=16):
    """Meter rates behind a converter that ends at `top`, with a gain of 12 000 electrons to it."""
    rng, gain = np.random.default_rng(seed), 12_000 / top
    sensor = Sensor(
        SHAPE, bits=bits, full_well=1e6, gain=gain, read_noise=3.0, black_level=0.02 * top
    )
    meter = Meter(sensor, limits, first, 40.0, 4.0, is_clip_told=False)
    while (time := meter.next_time) is not None:
        light = rng.poisson(rate * time) + rng.normal(0, 3, SHAPE)
        numbers = np.clip(np.rint(light / gain + 0.02 * top), 0, top)
        meter.add(time, numbers)
    return meter.metered_range


def star(pixels, peak=3e6):
    """A star, or few pixels of its brightness."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rate = 30 + peak * np.exp(-((y - 30.2) ** 2 + (x - 41.4) ** 2) / 30.0)
    return np.where(rate >= np.sort(rate.ravel())[-pixels], rate, 30.0)


@pytest.mark.parametrize("top", some([255, 1023, 4095, 65472, 65520], 0, 2, 3))
@pytest.mark.parametrize("first", [1e-4, 4e-3, 0.1])
@pytest.mark.parametrize("pixels", [4, 4800])
def test_light_is_metered_although_the_clip_level_is_not_told(top, first, pixels):
    rate = star(pixels)
    found = metered(rate, top, first, seed=pixels)
    assert found.high == pytest.approx(rate.max(), rel=0.05)
    assert not found.may_be_clipped
    assert found.clip_level in (None, top)


def test_what_one_exposure_alone_says_is_told_as_unknown():
    only = ExposureLimits(1e-3, 1e-3)
    assert metered(star(4, 6e6), 4095, 1e-3, 0, only).may_be_clipped
    # Four pixels that are clipped look as if they weren't.
    assert metered(star(4, 2e7), 4095, 1e-3, 0, only).may_be_clipped
