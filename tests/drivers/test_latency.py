"""Frames that a camera still exposes as before, told by their light."""

import numpy as np
import pytest

from drivers.latency import MOST_FRAMES, ExposureLatency, light_level


def picture(exposure, rng, black=64.0):
    """A small star on darkness."""
    image = rng.normal(black, 1.5, (80, 100))
    image[40:44, 50:54] += 4e5 * exposure
    return np.rint(image).astype(np.uint16)


def change(latency, old, new, late, rng, scale=1.0):
    """A change of exposure that a camera obeys `late` frames late, until a frame is taken."""
    latency.begin(old, new)
    for number in range(latency.frames + 1):
        latency.add(picture(scale * (old if number < late else new), rng))


@pytest.mark.parametrize("late", [1, 2, 4])
def test_a_jump_of_the_light_tells_when_a_camera_obeys(late):
    latency, rng = ExposureLatency(None, 3), np.random.default_rng(late)
    assert latency.frames == MOST_FRAMES
    change(latency, 1e-3, 3e-3, late, rng)
    assert latency.frames == max(3, late)


def test_a_camera_that_obeys_at_once_is_known_when_its_light_has_followed():
    latency, rng = ExposureLatency(None, 0), np.random.default_rng(0)
    change(latency, 1e-3, 3e-3, 0, rng)
    assert latency.frames == MOST_FRAMES
    change(latency, 3e-3, 1e-3, 0, rng)
    assert latency.frames == 0


def test_other_light_darkness_and_gaps_prove_nothing():
    rng = np.random.default_rng(1)
    for scales in ((1.0, 2.0), (0.0, 0.0)):
        latency = ExposureLatency(None, 0)
        for scale in scales:
            change(latency, 1e-3, 3e-3, 0, rng, scale)
        assert latency.frames == MOST_FRAMES
    latency = ExposureLatency(None, 0)
    latency.begin(1e-3, 3e-3)
    latency.forget_change()
    for number in range(20):
        latency.add(picture(1e-3 if number < 2 else 3e-3, rng))
    assert latency.frames == MOST_FRAMES


def test_a_level_is_that_of_the_brightest():
    image = np.zeros((100, 100), np.uint16)
    image[:4, :4] = 100
    assert light_level(image) == 100
