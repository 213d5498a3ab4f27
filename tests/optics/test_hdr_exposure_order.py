"""Frames of brackets in a wrong order, told by their brightness and by their pixels."""

import itertools

import numpy as np
import pytest

from optics.camera import Sensor
from optics.hdr import (
    MOVED,
    VALID,
    Bracket,
    explain_disorder,
    find_disorder,
    measure_exposure_factors,
    merge,
)

SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=0.0, black_level=64.0
)


def frames_and_rate(times, decades, seed=0, factors=None):
    """A scene of some decades from what nearly clips the shortest exposure."""
    rng = np.random.default_rng(seed)
    rate = 0.8 * 4031 * 2.6 / times[0] * 10 ** rng.uniform(-decades, 0, (100, 120))

    def number(light):
        electrons = rng.poisson(light) + rng.normal(0, 2.4, light.shape)
        return np.clip(np.round(electrons / 2.6 + 64), 0, 4095)

    factors = np.ones(len(times)) if factors is None else factors
    return [number(rate * t * k) for t, k in zip(times, factors, strict=True)], rate


def seen(frames, times):
    count = len(times)
    return Bracket(frames, times, [64.0] * count, [np.inf] * count, SENSOR)


@pytest.mark.parametrize(
    ("count", "ratio", "decades"), [(2, 2, 4), (2, 16, 2), (3, 16, 2), (4, 4, 2), (8, 4, 4)]
)
def test_any_two_exchanged_frames_are_named_and_merged_by_their_true_times(count, ratio, decades):
    times = 1e-3 * float(ratio) ** np.arange(count)
    frames, rate = frames_and_rate(times, decades)
    for one, other in itertools.combinations(range(count), 2):
        if max(np.mean(frames[k] < 4095) for k in (one, other)) < 0.03:
            # Two white frames are the same, whichever is which.
            continue
        turned = list(frames)
        turned[one], turned[other] = frames[other], frames[one]
        bracket = seen(turned, times)
        found = measure_exposure_factors(bracket)
        (words,) = found.explain()
        assert words.startswith(f"frames {one + 1} and {other + 1} look exchanged")
        merged = merge(bracket.with_factors(found.corrections))
        state, light = merged.state.numpy(), merged.rate.numpy()
        assert (state == MOVED).mean() < 0.01
        bright = (state == VALID) & (rate * times[-1] > 1e4)
        assert np.median(light[bright] / rate[bright]) == pytest.approx(1, abs=0.02)


def test_a_frame_of_a_wrong_time_is_not_taken_for_an_exchanged_one():
    """Both are darker than the frame before: only its pixels tell how dark it should be."""
    times = 1e-3 * 2.0 ** np.arange(6)
    for wrong, factor in ((2, 0.4), (4, 0.1), (1, 30.0)):
        factors = np.where(np.arange(6) == wrong, factor, 1.0)
        frames, _ = frames_and_rate(times, 4, factors=factors)
        found = measure_exposure_factors(seen(frames, times))
        assert found.suspects == [wrong]
        assert found.factors[wrong] == pytest.approx(factor, rel=0.02)
        (words,) = found.explain()
        assert words.startswith(f"frame {wrong + 1} has {factor:.2g}")
    frames, _ = frames_and_rate(times[:2] * np.array([1, 2]), 4, factors=[1.0, 0.1])
    found = measure_exposure_factors(seen(frames, times[:2] * np.array([1, 2])))
    assert found.disordered == ()
    assert found.factors[1] / found.factors[0] == pytest.approx(0.1, rel=0.02)


def test_an_order_of_more_than_two_is_named_and_flicker_is_not_taken_for_it():
    times = 1e-3 * 2.0 ** np.arange(5)
    frames, _ = frames_and_rate(times, 4)
    found = measure_exposure_factors(seen([frames[k] for k in (1, 2, 0, 3, 4)], times))
    (words,) = found.explain()
    assert words.startswith("frames 1, 2, 3 don't get brighter")
    times = 1e-3 * 1.3 ** np.arange(4)
    frames, _ = frames_and_rate(times, 3, factors=[1.3, 0.77, 0.71, 1.0])
    found = measure_exposure_factors(seen(frames, times))
    assert found.disordered == ()
    assert all("flickers" in words for words in found.explain())


def test_a_level_that_drifts_in_the_dark_is_no_disorder():
    rng, times = np.random.default_rng(5), 1e-3 * 8.0 ** np.arange(4)
    star = np.zeros((200, 200))
    star[100:106, 100:110] = 5e3
    frames = [
        np.round((rng.poisson(star * t) + rng.normal(0, 2.4, star.shape)) / 2.6 + 64 - drift)
        for t, drift in zip(times, (0.0, 0.15, 0.3, 0.45), strict=True)
    ]
    found = measure_exposure_factors(seen(frames, times))
    assert found.disordered == ()


def test_the_order_of_means_is_judged_as_it_is_said():
    times, noise = np.array([1.0, 2.0, 4.0, 8.0]), np.full(4, 1e-4)
    rising = np.array([0.1, 0.2, 0.4, 0.7])
    assert find_disorder(rising, noise, times) == ()
    assert find_disorder(rising[[0, 3, 2, 1]], noise, times) == (1, 3)
    # The times may be in any order.
    assert find_disorder(rising[::-1], noise, times[::-1]) == ()
    assert find_disorder(rising[[1, 2, 3, 0]], noise, times) == (0, 1, 2, 3)
    # What noise, flicker or a passer-by may do.
    assert find_disorder(np.array([0.1, 0.097, 0.4, 0.7]), noise, times) == ()
    assert find_disorder(np.array([0.1, 0.09, 0.4, 0.7]), np.full(4, 0.01), times) == ()
    # Nearly white frames.
    assert find_disorder(np.array([0.5, 1.0, 0.97, 1.0]), noise, times) == (1, 2)
    assert find_disorder(np.array([0.5, 0.97, 0.955, 1.0]), noise, times) == ()
    words = explain_disorder((0, 1, 2, 3))
    assert words.startswith("frames 1, 2, 3, 4 don't get brighter with their exposure times")
