"""Frames of a stream have the moments that are told, whichever way they are drawn."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats as st
import torch

from optics.camera import Panel, Sensor
from optics.sensor import moments
from simulator.recipe import Recipe
from simulator.streaming import FrameSimulator

SENSOR = Sensor(shape=(6, 8), bits=10, full_well=900.0, gain=1.1, read_noise=1.5, black_level=20.0,
                dark_current=3.0)  # fmt: skip
ALL = Recipe(
    Panel(), 64, 1, dark_current=True, fixed_pattern=True, shot="Poisson", clipping=True,
    read_noise=True, quantisation=True,
)  # fmt: skip
# Well into the knee at 900, and burnt; in between, a frame in thousands would make the variance.
LIGHT = torch.cat([torch.linspace(0, 890, 44), torch.full((4,), 2000.0)]).reshape(6, 8)
MANY = 4000


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def drawn(light, sensor, recipe, count=MANY, together=1):
    """Frames, so many together in one: as many pixels below each other, whose noise is their own.

    A sensor whose pixels differ has them one by one.
    """
    rows, columns = light.shape
    wide = replace(sensor, shape=(together * rows, columns))
    stream, chance = FrameSimulator(light.repeat(together, 1), 0.5, wide, recipe), generator()
    frames = np.stack([stream.frame(chance) for _ in range(count // together)])
    return frames.reshape(count, rows, columns)


UNEVEN = {"dsnu": 2.0, "prnu": 0.01, "hot": 0.1, "hot_current": 5}
CHANGES = (
    {}, {"shot": "skewed"},
    {"shot": "Gaussian"}, {"shot": "none"}, {"read_noise": False},
    {"shot": "Gaussian", "read_noise": False}, {"shot": "none", "read_noise": False},
    {"dark_current": False, "fixed_pattern": False}, {"shot": "skewed", "read_noise": False},
)  # fmt: skip


@pytest.mark.parametrize(
    ("change", "uneven"),
    [
        *((change, {}) for change in CHANGES),
        (CHANGES[1], UNEVEN),
        *(
            pytest.param(change, UNEVEN, marks=pytest.mark.sweep)
            for change in CHANGES
            if change is not CHANGES[1]
        ),
    ],
)
def test_frames_have_the_mean_and_variance_of_their_stages(change, uneven):
    """Each of 48 pixels from dark to burnt, within five standard errors of 4,000 frames."""
    recipe, sensor = replace(ALL, **change), replace(SENSOR, **uneven)
    frames = drawn(LIGHT, sensor, recipe, together=1 if uneven else 20)
    frames = (frames.astype(float) - 20) * 1.1
    stages = {name: getattr(recipe.stages, name) for name in (
        "dark_current", "fixed_pattern", "shot", "clipping", "read_noise"
    )}  # fmt: skip
    mean, variance = (one.numpy() for one in moments(LIGHT, 0.5, sensor, **stages))
    # A frame that never shows an electron that comes in one of 40,000 doesn't tell of it.
    seldom = 1.1**2 / MANY
    assert (np.abs(frames.mean(0) - mean) < 5.5 * np.sqrt(variance / MANY) + seldom).all()
    fourth = ((frames - frames.mean(0)) ** 4).mean(0)
    spread = np.sqrt(np.maximum(fourth - variance**2, variance**2) / MANY)
    assert (np.abs(frames.var(0) - variance) < 5.5 * spread + seldom).all()


def test_dim_pixels_beside_bright_ones_count_as_poisson_does():
    """No read noise, a step an electron: Kolmogorov's test against scipy."""
    sensor = replace(SENSOR, gain=1.0, dark_current=0.0, read_noise=0.0)
    light = torch.full((6, 8), 400.0)
    light[0] = 4.0
    recipe = replace(ALL, shot="Gaussian")
    numbers = drawn(light, sensor, recipe, 2000, together=20)[:, 0].ravel().astype(int) - 20
    counts = np.bincount(numbers, minlength=40) / numbers.size
    assert np.abs(counts.cumsum() - st.poisson.cdf(range(len(counts)), 4.0)).max() < 2 / math.sqrt(
        numbers.size
    )


@pytest.mark.parametrize("read", [0.0, 0.3, 2.4])
@pytest.mark.parametrize("electrons", [12.0, 150.0, 12_000.0])
@pytest.mark.parametrize("shot", ["skewed", "Poisson"])
def test_noises_together_are_distributed_as_each_by_itself(shot, electrons, read):
    """Kolmogorov's distance of 400,000 numbers from Poisson's sum over normal ones; a normal
    distribution of the same variance would be three times as far as is allowed, at 150."""
    sensor = Sensor(shape=(400, 1000), bits=16, full_well=6e4, gain=1.0, read_noise=read,
                    black_level=100.0, dark_current=0.0)  # fmt: skip
    recipe = replace(ALL, shot=shot, dark_current=False, fixed_pattern=False)
    light = torch.full(sensor.shape, electrons)
    numbers = (
        FrameSimulator(light, 0.5, sensor, recipe).frame(generator()).ravel().astype(int) - 100
    )
    assert distance(numbers, electrons, read) < 1.2 / math.sqrt(numbers.size)


def distance(numbers, electrons, read):
    """Kolmogorov's, of numbers from Poisson's distribution and a normal one together."""
    values = np.arange(numbers.min(), numbers.max() + 1)
    seen = np.bincount(numbers - values[0]).cumsum() / numbers.size
    far = 9 * math.sqrt(electrons) + 20
    counts = np.arange(max(0, int(electrons - far)), int(electrons + far))
    shares = st.poisson.pmf(counts, electrons)
    if read:
        true = st.norm.cdf((values[:, None] + 0.5 - counts) / read) @ shares
    else:
        true = st.poisson.cdf(values, electrons)
    return np.abs(seen - true).max()


@pytest.mark.parametrize("electrons", [5.0, 5800.0])
def test_few_pixels_among_others_are_distributed_as_by_themselves(electrons):
    """Where nearly all noises are merged: pixels with few electrons, and ones near the full well.

    The well is far enough for hardly a number in thousands to be cut.
    """
    sensor = Sensor(shape=(400, 1000), bits=16, full_well=6200.0, gain=1.0, read_noise=2.4,
                    black_level=100.0, dark_current=0.0)  # fmt: skip
    recipe = replace(ALL, shot="skewed", dark_current=False, fixed_pattern=False)
    light = torch.full(sensor.shape, 300.0)
    light.view(-1)[::20] = electrons
    frame = FrameSimulator(light, 0.5, sensor, recipe).frame(generator()).ravel().astype(int) - 100
    few, most = frame[::20], np.delete(frame, np.s_[::20])
    assert distance(few, electrons, 2.4) < 1.2 / math.sqrt(few.size)
    assert distance(most, 300.0, 2.4) < 1.2 / math.sqrt(most.size)


def test_a_frame_follows_from_the_generator_and_from_no_thread():
    big = torch.linspace(0, 800, 300 * 400).reshape(300, 400)
    sensor = replace(SENSOR, shape=(300, 400))
    one, two = (FrameSimulator(big, 0.5, sensor, ALL, threads=n) for n in (1, 2))
    chance, other = generator(3), generator(3)
    first = one.frame(chance)
    assert np.array_equal(first, two.frame(other))
    second = one.frame(chance)
    assert np.array_equal(second, two.frame(other))
    assert not np.array_equal(first, second)


def test_pixels_of_a_frame_dont_repeat_each_other():
    """Blocks have seeds of their own: correlation of one with the next, of 32,768 pixels."""
    sensor = replace(SENSOR, shape=(256, 256))
    frame = FrameSimulator(torch.full((256, 256), 300.0), 0.5, sensor, ALL).frame(generator())
    first, second = frame.ravel()[:32768].astype(float), frame.ravel()[32768:].astype(float)
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / math.sqrt(32768)


def test_frames_are_whole_numbers_in_the_converters_range():
    recipe = replace(ALL, clipping=False, quantisation=False)
    frame = FrameSimulator(LIGHT * 100, 0.5, SENSOR, recipe).frame(generator())
    assert frame.dtype == np.uint16
    assert frame.shape == (6, 8)
    assert frame.max() == 1023


def test_without_noise_nothing_is_drawn():
    """The generator gives seeds only, and all frames are the rounded mean."""
    recipe = replace(ALL, shot="none", read_noise=False)
    stream = FrameSimulator(LIGHT, 0.5, SENSOR, recipe)
    expected = np.round(np.minimum(LIGHT.double().numpy() + 1.5, 900) / 1.1 + 20)
    assert np.array_equal(stream.frame(generator(1)), expected)
    assert np.array_equal(stream.frame(generator(2)), expected)
    assert stream.bytes == 48 * 4


def test_any_amount_of_light_can_be_drawn():
    frame = FrameSimulator(torch.full((6, 8), 1e30), 0.5, SENSOR, ALL).frame(generator())
    assert (np.abs(frame.astype(float) - round(900 / 1.1 + 20)) < 10).all()


@pytest.mark.parametrize(
    ("light", "exposure", "threads", "message"),
    [
        (torch.full((6, 8), math.nan), 1.0, 1, "electrons has 48 NaN or infinite values"),
        (torch.ones(6, 8), -1.0, 1, "exposure is -1 s; it must be positive"),
        (torch.ones(6, 8), 1.0, 0, "threads is 0; one at least has to draw"),
    ],
)
def test_streams_that_cant_be_are_refused(light, exposure, threads, message):
    with pytest.raises(ValueError, match=message):
        FrameSimulator(light, exposure, SENSOR, ALL, threads)
