"""Merging against brackets from numpy's own generator, and the Cramér-Rao bound."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from sweeps import some

from optics.camera import Sensor
from optics.hdr import CLIPPED, DARK, VALID, Bracket, merge

SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=1.0, black_level=64.0
)
EXPOSURES = np.array([1e-3, 1e-2, 1e-1, 1.0])
DARKS = 16
PIXELS = 40_000


def bracket(rate: float, seed: int, pixels=PIXELS, sensor: Sensor = SENSOR, dark_frames=DARKS):
    """Frames and mean darks of a uniform field, from the definitions of EMVA 1288."""
    rng = np.random.default_rng(seed)

    def shot(light: float, t: float) -> np.ndarray:
        electrons = rng.poisson((light + sensor.dark_current) * t, pixels)
        electrons = electrons + rng.normal(0, sensor.read_noise, pixels)
        number = np.round(electrons / sensor.gain + sensor.black_level)
        return np.clip(number, 0, 2**sensor.bits - 1)

    frames = np.stack([shot(rate, t) for t in EXPOSURES])
    darks = np.stack([np.mean([shot(0, t) for _ in range(dark_frames)], axis=0) for t in EXPOSURES])
    return frames[:, None, :], darks[:, None, :]


def merged(frames, darks, sensor: Sensor = SENSOR, dark_frames=DARKS):
    return merge(Bracket(frames, EXPOSURES, darks, [dark_frames] * len(EXPOSURES), sensor))


def cramer_rao(rate: float) -> float:
    """Least variance: information t² / variance of every exposure that doesn't clip."""
    information = 0.0
    for t in EXPOSURES:
        if rate * t < 0.9 * (4095 - 64) * SENSOR.gain:
            dark = SENSOR.dark_current * t
            floor = SENSOR.read_noise**2 + SENSOR.gain**2 / 12 + dark
            information += t**2 / (rate * t + floor * (1 + 1 / DARKS))
    return 1 / information


@pytest.mark.parametrize("rate", some([5.0, 50.0, 500.0, 5e3, 5e4, 5e5, 5e6], 0, 2, 4, 6))
def test_the_merged_rate_is_unbiased_and_reaches_the_cramer_rao_bound(rate):
    """Seven decades, none within 40 % of clipping: 4031 x 2.6 / t."""
    result = merged(*bracket(rate, seed=int(rate)))
    value = result.rate.numpy().ravel()
    bound = cramer_rao(rate)
    # Chance makes exposures contradict each other in few pixels.
    valid = result.state.numpy().ravel()[value > 4 * math.sqrt(bound)] == VALID
    assert valid.mean() >= 0.999
    # Weights that come from the noisy value itself may cost a bias of a few percent of sigma.
    assert value.mean() == pytest.approx(rate, abs=math.sqrt(bound) * (5 / 200 + 0.02))
    assert bound / np.mean((value - rate) ** 2) >= 0.98 - 5 * math.sqrt(2 / PIXELS)
    assert bound / value.var() >= 0.98 - 5 * math.sqrt(2 / PIXELS)


@pytest.mark.parametrize(
    ("rate", "dark_frames", "coarse"),
    some(
        itertools.product([5.0, 500.0, 5e4, 5e6], [1, 16], [False, True]),
        *(0, 3, 5, 6, 8, 11, 13, 14),
    ),
)
def test_the_stated_variance_is_the_achieved_one(rate, dark_frames, coarse):
    """Photons, dark current, read noise, quantisation and the subtracted dark, all counted:
    with coarse steps quantisation counts as much as reading, one dark frame doubles both."""
    sensor = replace(SENSOR, gain=7.0, read_noise=3.5) if coarse else SENSOR
    frames, darks = bracket(rate, 1, PIXELS, sensor, dark_frames)
    result = merged(frames, darks, sensor, dark_frames)
    stated = float(result.variance.mean())
    assert stated == pytest.approx(float(result.rate.var()), rel=0.05)


def test_a_value_next_to_clipping_is_hardly_biased():
    """A frame at full scale is right half of the time only: its fluctuations select it."""
    rate = (4095 - 64) * SENSOR.gain / 1e-1
    value = merged(*bracket(rate, seed=2)).rate.numpy()
    assert value.mean() == pytest.approx(rate, rel=0.01)


def test_a_full_well_never_passes_for_a_value():
    """A well that ends before the converter, with read noise on top: all frames but the
    shortest are full, and the shortest alone decides."""
    sensor = Sensor(
        bits=12, full_well=5000.0, gain=2.6, read_noise=8.0, dark_current=0.0, black_level=64.0
    )
    rng = np.random.default_rng(3)
    rate = 2e6
    electrons = np.minimum(rng.poisson(rate * EXPOSURES[:, None], (4, PIXELS)), sensor.full_well)
    number = np.round((electrons + rng.normal(0, 8.0, electrons.shape)) / 2.6 + 64)[:, None, :]
    result = merged(number, np.full_like(number, 64.0), sensor)
    assert float(result.rate.mean()) == pytest.approx(rate, rel=0.005)
    assert float(result.rate.min()) > 0.8 * rate


def test_a_pixel_clipped_in_every_exposure_is_a_lower_bound():
    frames, darks = bracket(1e9, seed=4, pixels=10)
    result = merged(frames, darks)
    assert (result.state == CLIPPED).all()
    assert torch.isfinite(result.rate).all()
    assert (result.rate > 0).all()
    assert (result.rate < 1e9).all()
    # The highest rate that the shortest exposure can tell.
    highest = (4095 - 64) * 2.6 / 1e-3
    assert result.rate.numpy() == pytest.approx(highest, rel=0.01)
    assert torch.isinf(result.variance).all()


def test_a_dark_pixel_is_marked_and_zero_on_average():
    result = merged(*bracket(0.0, seed=5))
    assert (result.state == DARK).float().mean() > 0.99
    sigma = math.sqrt(cramer_rao(0.0))
    assert float(result.rate.mean()) == pytest.approx(0, abs=6 * sigma / math.sqrt(PIXELS))


def test_fifteen_stops_of_a_twelve_bit_sensor_stay_in_order():
    """Radiances over 2^15 x 2^12 come out with the relative error of their photons."""
    truth = np.geomspace(20.0, 4e6, 300)
    rng = np.random.default_rng(6)
    frames = np.round(rng.poisson(truth * EXPOSURES[:, None]) / 2.6 + 64).clip(0, 4095)
    darks = np.full_like(frames, 64.0)
    result = merged(frames[:, None].astype(np.float32), darks[:, None].astype(np.float32))
    error = np.abs(result.rate.numpy()[0] - truth)
    assert (error <= 6 * result.variance.sqrt().numpy()[0]).all()


def test_the_order_of_exposures_does_not_matter():
    frames, darks = bracket(5e4, seed=7, pixels=50)
    forward = merged(frames, darks)
    turned = merge(Bracket(frames[::-1], EXPOSURES[::-1], darks[::-1], [DARKS] * 4, SENSOR))
    assert torch.allclose(forward.rate, turned.rate, rtol=1e-6)


def test_integer_frames_are_accepted():
    frames, darks = bracket(500.0, seed=8, pixels=20)
    whole = merged(frames.astype(np.int32), darks)
    assert torch.equal(whole.rate, merged(frames, darks).rate)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"darks": np.zeros((2, 3, 4))}, r"dark is \(3, 4\) and the frames \(3, 3\)"),
        ({"exposures": np.ones(3)}, r"3 exposures don't match"),
        ({"exposures": [1.0, 0.0]}, r"exposures are .* all must be positive"),
        ({"exposures": [1.0, math.nan]}, r"exposures are .* all must be positive"),
        ({"dark_counts": [1, 0]}, r"dark_counts are \[1.0, 0.0\]; .*at least 1"),
        ({"dark_counts": np.ones(3)}, r"dark_counts"),
        ({"frames": np.full((2, 3, 3), math.nan)}, r"frame 0 has NaN or infinite"),
        ({"darks": np.full((2, 3, 3), math.inf)}, r"dark 0 has NaN or infinite"),
        (
            {"frames": np.ones((0, 3, 3)), "darks": np.ones((0, 3, 3)),
             "exposures": np.ones(0), "dark_counts": np.ones(0)},
            r"no exposures",
        ),
    ],
)  # fmt: skip
def test_a_bracket_that_does_not_fit_is_refused(change, words):
    good = {
        "frames": np.zeros((2, 3, 3)),
        "exposures": np.ones(2),
        "darks": np.zeros((2, 3, 3)),
        "dark_counts": np.ones(2),
    }
    with pytest.raises(ValueError, match=words):
        merge(Bracket(**{**good, **change}, sensor=SENSOR))
