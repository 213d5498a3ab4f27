"""Estimates near clip levels, on brackets of numpy's own generator: bias, efficiency, variance."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
from sweeps import some

from optics.camera import Sensor
from optics.hdr import CLIPPED, MAY_CLIP, MOVED, VALID, Bracket, merge
from optics.hdr.clip_levels import least_variance, near_clipping

SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=1.0, black_level=64.0
)
TOP = (4095 - 0.5 - 64) * SENSOR.gain
"""Electrons at which an exposure clips."""

PIXELS = 60_000


def frame(rng, light, t):
    electrons = rng.poisson((light + SENSOR.dark_current) * t, (1, PIXELS))
    number = (electrons + rng.normal(0, SENSOR.read_noise, electrons.shape)) / SENSOR.gain
    return np.clip(np.round(number + SENSOR.black_level), 0, 4095)


@cache
def mean_dark(t, seed, darks):
    rng = np.random.default_rng((seed, darks))
    return np.mean([frame(rng, 0, t) for _ in range(darks)], axis=0)


def bracket(rate, times, seed, darks=16):
    """Frames and darks of even light, as EMVA 1288 defines them; equal times share their darks."""
    rng = np.random.default_rng(seed)
    return Bracket(
        [frame(rng, rate, t) for t in times], times, [mean_dark(t, seed, darks) for t in times],
        [darks] * len(times), SENSOR,
    )  # fmt: skip


def bound(rate, times, darks):
    """Cramér-Rao: every exposure that isn't near its clip level, and one that may be."""
    information, near = 0.0, None
    for t in sorted(times):
        floor = SENSOR.read_noise**2 + SENSOR.gain**2 / 12 + SENSOR.dark_current * t
        deviation = np.sqrt(rate * t + floor * (1 + 1 / darks))
        above = (rate * t - TOP) / deviation
        if above < -8:
            information += t**2 / deviation**2
        elif near is None:
            near = (above, deviation / t)
    if near is None:
        return 1 / information
    above, own = near
    return own**2 * float(least_variance(np.array([above]), 1 / np.sqrt(information) / own)[0])


@pytest.mark.parametrize(
    ("ratio", "share", "darks"),
    some(
        itertools.product([2, 4, 16], [0.95, 0.98, 0.99, 1.0, 1.01, 1.02, 1.05, 1.1], [1, 16]),
        *range(0, 48, 5),
        47,
    ),
)
def test_bias_and_stated_variance_near_a_clip_level(share, ratio, darks):
    """Of the longest of three exposures; chance explains four standard errors of a bias."""
    times = [1e-3, 1e-3 * ratio, 1e-3 * ratio**2]
    rate = share * TOP / times[-1]
    found = merge(bracket(rate, times, 1, darks))
    error = found.rate.numpy().astype(float) - rate
    chance = 4 * error.std() / np.sqrt(PIXELS)
    assert abs(error.mean()) <= 1e-3 * rate + chance
    stated = float(found.variance.numpy().mean())
    assert 0.9 <= np.mean(error**2) / stated <= 1.1
    assert float((found.state == VALID).float().mean()) >= 0.999


@pytest.mark.parametrize("share", some([0.95, 0.98, 0.99, 1.0, 1.02, 1.05], 1, 3, 5))
def test_efficiency_near_a_clip_level_of_a_ladder_of_two(share):
    times = [1e-3 * 2**k for k in range(6)]
    rate = share * TOP / times[-1]
    error = merge(bracket(rate, times, 2)).rate.numpy().astype(float) - rate
    assert bound(rate, times, 16) / np.mean(error**2) >= 0.9 - 4 * np.sqrt(2 / PIXELS)


@pytest.mark.parametrize("shorter", [1.0, 1.7, 4.0])
def test_estimates_are_hardly_biased(shorter):
    """Whatever the light near the level; the least error is chosen by linear algebra."""
    rng, design = np.random.default_rng(3), near_clipping(shorter)
    light = np.repeat(np.arange(-6.0, 6.0, 0.5), 4000)
    value = rng.normal(light, 1)
    other = rng.normal(light, shorter)
    share = 1 / (1 + shorter**2)
    mean = share * other + (1 - share) * value
    estimate = np.where(value > 0, design.from_clipped(other)[0], design.from_open(mean)[0])
    by_light = (estimate - light).reshape(-1, 4000)
    assert np.abs(by_light.mean(1)).max() <= 0.1 + 5 * by_light.std() / np.sqrt(4000)
    # To leave clipped exposures out is biased by more.
    plain = np.where(value > 0, other, mean)
    assert np.abs((plain - light).reshape(-1, 4000).mean(1)).max() > 0.15


def test_far_from_the_level_nothing_is_corrected():
    design = near_clipping(2.0)
    value, variance = design.from_open(np.array([-50.0, -8.0]))
    assert value == pytest.approx([-50.0, -8.0])
    assert variance == pytest.approx(0.8, rel=0.03)
    value, variance = design.from_clipped(np.array([30.0, 100.0]))
    assert value == pytest.approx([30.0, 100.0])
    assert variance == pytest.approx(4.0, rel=0.03)


@pytest.mark.parametrize(
    ("away", "state"), [(-7.0, VALID), (-4.0, MAY_CLIP), (0.0, MAY_CLIP), (8.0, CLIPPED)]
)
def test_a_single_exposure_says_where_it_may_be_clipped(away, state):
    """In standard deviations of its noise; what no other exposure tells is biased there."""
    rate = (TOP + away * np.sqrt(TOP)) / 1e-2
    found = merge(bracket(rate, [1e-2], 4))
    states = found.state.numpy()
    assert (states == CLIPPED).all() == (state == CLIPPED)
    # Values scatter around the place by one standard deviation.
    assert ((states == state) | (states == CLIPPED)).mean() >= 0.8
    assert np.isfinite(found.rate.numpy()).all()
    assert not np.isnan(found.variance.numpy()).any()


@pytest.mark.parametrize("darks", [1, 4])
def test_frames_of_one_time_share_the_noise_of_their_dark_frames(darks):
    """Eight frames of a dim picture less the same dark: its noise doesn't average out."""
    times, rate = [0.01] * 8, 300.0
    found = merge(bracket(rate, times, 5, darks))
    error = found.rate.numpy().astype(float) - rate
    assert np.mean(error**2) / float(found.variance.numpy().mean()) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("moved", some(range(5), 0, 4))
def test_an_exposure_in_which_something_moved_is_left_out(moved):
    times, rate = [1e-3 * 2**k for k in range(6)], 0.3 * TOP / 32e-3
    still = bracket(rate, times, 6)
    frames = [np.array(one) for one in still.frames]
    deviation = np.sqrt(rate * times[moved] + 7.3)
    half = slice(0, PIXELS // 2)
    frames[moved][:, half] += np.round(8 * deviation / SENSOR.gain)
    found = merge(Bracket(frames, times, still.darks, still.dark_counts, SENSOR))
    out = found.state.numpy()[0] == MOVED
    assert out[half].mean() >= 0.95
    assert out[PIXELS // 2 :].mean() <= 1e-3
    error = found.rate.numpy()[0][half].mean() - rate
    assert abs(error) <= 0.1 * np.sqrt(float(found.variance.numpy().mean()))


def test_what_passes_before_a_clipped_exposure_is_left_out():
    """Bright in the short exposures, dark in the one that should be clipped."""
    times, rate = [1e-3, 4e-3, 16e-3], 2 * TOP / 16e-3
    still = bracket(rate, times, 7)
    frames = [np.array(one) for one in still.frames]
    frames[2][:] = 500.0
    found = merge(Bracket(frames, times, still.darks, still.dark_counts, SENSOR))
    assert (found.state.numpy() == MOVED).mean() >= 0.999
    assert found.rate.numpy().mean() == pytest.approx(rate, rel=1e-3)


@pytest.mark.parametrize("method", ["plain", "Poisson", "Granados"])
def test_quicker_methods_state_their_own_variance(method):
    times = [1e-3, 8e-3, 64e-3]
    for rate in (2e3, 2e5):
        found = merge(bracket(rate, times, 8), method)
        error = found.rate.numpy().astype(float) - rate
        stated = float(found.variance.numpy().mean())
        assert np.mean(error**2) / stated == pytest.approx(1, abs=0.06)


def test_weights_that_know_the_noise_are_better():
    times, rate = [1e-3, 8e-3, 64e-3], 500.0
    errors = [
        np.std(merge(bracket(rate, times, 9), method).rate.numpy())
        for method in ("Poisson", "Granados")
    ]
    assert errors[1] < errors[0]


def test_defects_are_said_to_be_defects():
    seen = bracket(1e4, [1e-3, 1e-2], 10)
    mask = np.zeros((1, PIXELS), dtype=bool)
    mask[0, 5] = True
    found = merge(seen, defects=mask)
    assert math.isinf(found.variance[0, 5])
    assert int((found.state == 5).sum()) == 1


def test_another_method_or_mask_is_refused():
    seen = bracket(1e4, [1e-3], 11)
    with pytest.raises(ValueError, match="method is 'best'; choose one of plain, Poisson"):
        merge(seen, "best")
    with pytest.raises(ValueError, match=r"defects are \(2, 2\)"):
        merge(seen, defects=np.zeros((2, 2), dtype=bool))
    with pytest.raises(ValueError, match="one size"):
        Bracket([np.zeros((2, 2)), np.zeros((3, 2))], [1.0, 2.0], [0.0, 0.0], [1, 1], SENSOR)
