"""Hot and stuck pixels among frames and darks of numpy's own generator."""

import numpy as np

from optics.camera import Sensor
from optics.hdr import DEFECTIVE, Bracket, find_defects, merge

SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=1.0, black_level=64.0
)
TIMES = [1e-3, 8e-3, 64e-3, 0.5]
SHAPE = (120, 160)
HOT, STUCK = [(5, 7), (80, 3), (100, 150)], [(20, 20), (60, 90)]


def bracket(darks=4, times=TIMES):
    """A scene of four decades; three pixels have a dark current of 5000 electrons per second, and
    two have the number 700 always."""
    rng = np.random.default_rng(1)
    current = np.full(SHAPE, SENSOR.dark_current)
    current[tuple(zip(*HOT, strict=True))] = 5000.0
    rate = 10 ** rng.uniform(1, 5, SHAPE)

    def frame(light, t):
        electrons = rng.poisson((light + current) * t) + rng.normal(0, 2.4, SHAPE)
        number = np.clip(np.round(electrons / 2.6 + 64), 0, 4095)
        number[tuple(zip(*STUCK, strict=True))] = 700
        return number

    frames = [frame(rate, t) for t in times]
    means = [np.mean([frame(0, t) for _ in range(darks)], axis=0) for t in times]
    return frames, means


def test_hot_pixels_are_found_in_dark_frames_and_stuck_ones_in_all():
    frames, means = bracket()
    found = find_defects(Bracket(frames, TIMES, means, [4] * 4, SENSOR))
    # What is stuck has a high number in the dark as well.
    assert sorted(map(tuple, np.argwhere(found.mask).tolist())) == sorted(HOT + STUCK)
    merged = merge(Bracket(frames, TIMES, means, [4] * 4, SENSOR), defects=found.mask)
    assert (merged.state.numpy()[found.mask] == DEFECTIVE).all()
    assert np.isinf(merged.variance.numpy()[found.mask]).all()
    assert "5 pixels are hot" in found.explain()[0]
    assert "(5, 7)" in found.explain()[0]


def test_without_dark_frames_stuck_pixels_are_found():
    frames, _ = bracket()
    found = find_defects(Bracket(frames, TIMES, [64.0] * 4, [1] * 4, SENSOR))
    assert not found.hot.any()
    assert np.argwhere(found.stuck).tolist() == [list(one) for one in STUCK]
    assert "one number at all exposure times" in found.explain()[0]


def test_dark_and_clipped_pixels_are_no_defects():
    rng = np.random.default_rng(2)
    dark = np.round(64 + rng.normal(0, 1, SHAPE))
    for number in (dark, np.full(SHAPE, 4095.0)):
        found = find_defects(Bracket([number] * 4, TIMES, [dark] * 4, [1] * 4, SENSOR))
        assert not found.mask.any()
        assert found.explain() == []


def test_two_exposures_are_too_few_to_call_a_pixel_stuck():
    frames, _ = bracket(times=TIMES[:2])
    found = find_defects(Bracket(frames, TIMES[:2], [64.0] * 2, [1] * 2, SENSOR))
    assert not found.mask.any()


def test_darks_of_one_whole_number_have_no_hot_pixels():
    frames = [np.full(SHAPE, 100.0)] * 2
    dark = np.full(SHAPE, 64.0)
    dark[0, 0] = 65
    found = find_defects(Bracket(frames, TIMES[:2], [dark] * 2, [1] * 2, SENSOR))
    assert not found.mask.any()
