"""Gain and read noise that an exposure bracket shows itself, against frames made by numpy."""

import numpy as np
import pytest
from skimage import data

from optics import hdr
from optics.camera import Sensor

TIMES = (1.0, 4.0, 16.0, 64.0)


def frames(scene, gain, noise, seed, times=TIMES, black=64.0):
    """Frames of light, whose brightest pixel has 1600 numbers in the third exposure."""
    rng = np.random.default_rng(seed)
    every = []
    for time in times:
        electrons = rng.poisson(scene * time * 100 * gain) + rng.normal(0, noise, scene.shape)
        every.append(np.clip(np.rint(electrons / gain + black), 0, 4095).astype(np.uint16))
    return every


@pytest.fixture(scope="module")
def scene():
    return data.camera()[100:400, 100:400] / 255 + 0.002


@pytest.mark.parametrize(("gain", "noise"), [(2.6, 2.4), (0.4, 3.0), (0.9, 10.0)])
def test_gain_and_read_noise_are_found(scene, gain, noise):
    every = frames(scene, gain, noise, 1)
    # Exposure times that are wrong change nothing: their ratios are measured.
    found = hdr.estimate_bracket_noise(every, [64.0] * 4, (1, 4.6, 16, 64), 4095, (2, 2))
    assert abs(found.gain - gain) < 4 * found.gain_deviation + 0.01 * gain
    assert found.gain_deviation < 0.02 * gain
    assert found.share > 0.85
    # Rounding is a part of what is seen in the dark.
    assert found.read_noise == pytest.approx(noise, rel=0.05)


def test_what_moves_in_a_part_of_the_frames_is_left_out(scene):
    every = frames(scene, 1.5, 4.0, 2)
    other = frames(scene[::-1, ::-1], 1.5, 4.0, 3)
    for number in (1, 3):
        every[number][:100] = other[number][:100]
    found = hdr.estimate_bracket_noise(every, [64.0] * 4, TIMES, 4095)
    assert found.gain == pytest.approx(1.5, rel=0.1)
    assert found.read_noise == pytest.approx(4, rel=0.1)
    assert found.share < 0.8


def test_frames_that_do_not_tell_are_refused(scene):
    every = frames(scene, 1.5, 4.0, 4)
    with pytest.raises(ValueError, match="no two frames"):
        hdr.estimate_bracket_noise(every[:1], [64.0], TIMES[:1], 4095)
    clipped = [np.full_like(every[0], 4095)] * 2
    with pytest.raises(ValueError, match="no two frames"):
        hdr.estimate_bracket_noise(clipped, [64.0] * 2, TIMES[:2], 4095)
    with pytest.raises(ValueError, match="don't tell photons' noise"):
        hdr.estimate_bracket_noise([every[2]] * 2, [64.0] * 2, (1, 1), 4095)


def test_a_stated_level_of_darkness_makes_no_pixel_hot():
    level = np.full((40, 40), 512.0)
    level[::2, ::2] = 540
    numbers = [level + 20, level + 80]
    sensor = Sensor(bits=14, full_well=1e9, black_level=0.0, dark_current=0.0, shape=(40, 40))
    stated = hdr.Bracket(numbers, (1, 4), [level] * 2, [np.inf] * 2, sensor)
    assert not hdr.find_defects(stated).hot.any()
    measured = hdr.Bracket(numbers, (1, 4), [level] * 2, [4, 4], sensor)
    assert hdr.find_defects(measured).hot.any()
