"""What few exposures tell of a camera, whose converter is modelled here by numpy alone."""

import numpy as np
import pytest

from optics.camera import Sensor
from optics.measuring.few_exposures import FewExposures

SHAPE = (60, 80)
TIMES = np.geomspace(1e-4, 0.4, 7)


def frames(black=60.0, top=4095, shift=0, gamma=1.0, well=np.inf, peak=1e6, seed=0):
    """A star of 20000 electrons or more at the longest exposures, by a converter of gain 3."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rate = peak * np.exp(-((y - 30) ** 2 + (x - 41) ** 2) / 40.0)
    seen = []
    for time in TIMES:
        light = np.minimum(rng.poisson(rate * time), well) + rng.normal(0, 4.0, SHAPE)
        number = light / 3
        if gamma != 1:
            number = top * (np.clip(number, 0, None) / top) ** gamma
        seen.append(np.clip(np.rint(number + black), 0, top).astype(np.uint16) << shift)
    return FewExposures(TIMES.tolist(), seen)


@pytest.mark.parametrize(
    ("top", "shift"), [(255, 0), (1023, 0), (1023, 2), (4095, 0), (4095, 4), (255, 8)]
)
def test_the_clip_level_is_that_of_the_converter(top, shift):
    seen = frames(black=20.0, top=top, shift=shift)
    assert seen.clip is not None
    assert (seen.clip.number, seen.clip.limit) == (top << shift, "converter")
    assert seen.black_level.value == pytest.approx(20 << shift, abs=0.3 * 2**shift)


def test_full_wells_clip_below_the_converter():
    clip = frames(well=6000.0).clip
    assert clip is not None
    assert clip.limit == "well"
    # 2000 numbers above black, with a noise of 4 / 3.
    assert 2060 - 10 <= clip.number <= 2060


def test_a_clip_level_that_no_exposure_reaches_is_not_named():
    assert frames(peak=5e3).clip is None


@pytest.mark.parametrize(("gamma", "linear"), [(1.0, True), (0.45, False), (1.2, False)])
def test_a_gamma_is_found(gamma, linear):
    found = frames(gamma=gamma, top=65535).linearity
    assert found is not None
    assert (abs(found.exponent.value - 1) < 0.03 + 4 * found.exponent.sigma) is linear
    assert found.exponent.value == pytest.approx(gamma, abs=0.02 + 4 * found.exponent.sigma)


def test_darkness_that_is_cut_off_and_a_cap_are_told():
    assert frames(black=0.0).is_cut_at_zero
    assert not frames().is_cut_at_zero
    assert frames().sees_light
    dark = frames(peak=1e-3)
    assert not dark.sees_light
    assert (dark.clip, dark.linearity) == (None, None)
    assert dark.black_level.value == pytest.approx(60, abs=0.1)


def test_exposures_that_do_not_rise_are_refused():
    with pytest.raises(ValueError, match="must rise"):
        FewExposures([1.0, 1.0], [np.zeros(SHAPE), np.zeros(SHAPE)])


def test_a_sensors_clip_level_is_its_full_scale():
    sensor = Sensor(bits=16, gain=0.16, full_well=1e6, black_level=1024.0, clip_level=65520)
    assert (sensor.full_scale, sensor.top_number) == (65520, 65520)
    with pytest.raises(ValueError, match="clip_level is 70000"):
        Sensor(bits=16, clip_level=70000)
