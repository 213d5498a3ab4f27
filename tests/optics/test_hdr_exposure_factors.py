"""Factors of exposures against those that frames of numpy's own generator were made with."""

import numpy as np
import pytest
from sweeps import some

from optics.camera import Sensor
from optics.hdr import Bracket, measure_exposure_factors, merge

SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=1.0, black_level=64.0
)
TOP = 4031 * SENSOR.gain


def bracket(times, factors, seed, shape=(200, 500), darks=8):
    """A scene of five decades, and its radiance."""
    rng = np.random.default_rng(seed)
    rate = TOP / times[0] * 10 ** rng.uniform(-5, 0.2, shape)

    def frame(light, t):
        electrons = rng.poisson(light + SENSOR.dark_current * t, shape)
        number = (electrons + rng.normal(0, SENSOR.read_noise, shape)) / SENSOR.gain
        return np.clip(np.round(number + SENSOR.black_level), 0, 4095)

    frames = [frame(rate * t * k, t) for t, k in zip(times, factors, strict=True)]
    mean = [np.mean([frame(0, t) for _ in range(darks)], axis=0) for t in times]
    return Bracket(frames, times, mean, [darks] * len(times), SENSOR), rate


@pytest.mark.parametrize(("count", "ratio"), some([(2, 8), (3, 16), (4, 4), (6, 2)], 1, 3))
def test_exposures_that_are_some_percent_off(count, ratio):
    times = 1e-3 * ratio ** np.arange(count)
    factors = np.exp(np.random.default_rng(1).normal(0, 0.03, count))
    factors /= np.exp(np.median(np.log(factors)))
    seen, rate = bracket(times, factors, 2)
    found = measure_exposure_factors(seen)
    assert found.factors == pytest.approx(factors, rel=1e-3)
    assert (np.abs(found.factors / factors - 1) <= 5 * found.deviations).all()
    assert found.scatter == pytest.approx(1, abs=0.02)
    # With them, the error that is left is the one that is stated; without, it isn't.
    bright = rate * times[-1] > 1000
    left = []
    for one in (seen, seen.with_factors(found.factors)):
        merged = merge(one)
        error = (merged.rate.numpy() - rate)[bright]
        variance = merged.variance.numpy()[bright]
        fine = np.isfinite(variance)
        each = rate[bright][fine] ** 2
        left.append(np.mean(error[fine] ** 2 / each) / np.mean(variance[fine] / each))
    assert left[1] == pytest.approx(1, abs=0.06)
    assert left[0] > 1.1


def test_a_wrong_exposure_is_named_and_a_right_one_is_not():
    rng, times = np.random.default_rng(3), 1e-3 * 2.0 ** np.arange(8)
    for seed in range(6):
        factors = np.ones(8)
        wrong = int(rng.integers(8))
        factors[wrong] = rng.choice([0.95, 1.05])
        found = measure_exposure_factors(bracket(times, factors, seed, (60, 200))[0])
        assert found.suspects == [wrong]
        (words,) = found.explain()
        assert f"frame {wrong + 1} has" in words
        # A short one may have been taken in flickering light; a long one wasn't.
        assert ("flickers" in words) == (times[wrong] < 0.1)
    right = measure_exposure_factors(bracket(times, np.ones(8), 9, (60, 200))[0])
    assert right.explain() == []
    assert (right.corrections == 1).all()


def test_exchanged_frames_are_told_as_such():
    times = 1e-3 * 2.0 ** np.arange(6)
    seen, _ = bracket(times, np.ones(6), 4, (60, 200))
    frames, darks = list(seen.frames), list(seen.darks)
    frames[1], frames[4] = frames[4], frames[1]
    darks[1], darks[4] = darks[4], darks[1]
    found = measure_exposure_factors(Bracket(frames, times, darks, seen.dark_counts, SENSOR))
    (words,) = found.explain()
    assert words.startswith("frames 2 and 5 look exchanged")


def test_things_that_move_do_not_count_as_exposure():
    times = 1e-3 * 2.0 ** np.arange(5)
    seen, _ = bracket(times, np.ones(5), 5, (100, 300))
    frames = [np.array(one) for one in seen.frames]
    frames[3][:20] = np.clip(frames[3][:20] * 1.5, 0, 4095)
    moved = Bracket(frames, times, seen.darks, seen.dark_counts, SENSOR)
    found = measure_exposure_factors(moved)
    assert found.suspects == []
    assert found.factors == pytest.approx(np.ones(5), abs=3e-3)


def test_too_little_to_tell_is_refused():
    seen, _ = bracket(np.array([1e-3, 1e-2]), np.ones(2), 6, (20, 20))
    with pytest.raises(ValueError, match="one frame has no ratio"):
        measure_exposure_factors(
            Bracket(list(seen.frames)[:1], [1e-3], list(seen.darks)[:1], [8], SENSOR)
        )
    dark = Bracket([np.full((20, 20), 64.0)] * 2, [1e-3, 1e-2], [64.0] * 2, [8, 8], SENSOR)
    with pytest.raises(ValueError, match="no pixels are bright"):
        measure_exposure_factors(dark)
