"""A camera measured from its frames gives the values that were put in, within 2 %."""

import numpy as np
import pytest
import torch

from optics.camera import Sensor
from optics.sensor import sample_frame
from optics.sensor.emva1288 import measure_characteristics, pair_moments, uniformity

TRUE = Sensor(
    shape=(256, 256), bits=12, full_well=12_000.0, gain=3.3, read_noise=7.0, dark_current=40.0,
    black_level=120.0, prnu=0.01, dsnu=2.5, fixed_seed=3,
)  # fmt: skip
RATE = 4000.0
EXPOSURES = np.linspace(0.06, 3.0, 50)


def frames(rate, exposure, count, seed, sensor=TRUE, **stages):
    generator = torch.Generator().manual_seed(seed)
    light = torch.full(sensor.shape, rate * exposure)
    return [
        sample_frame(light, exposure, sensor, generator, **stages).numpy() for _ in range(count)
    ]


@pytest.fixture(scope="module")
def found():
    lit = {t: tuple(frames(RATE, t, 2, n)) for n, t in enumerate(EXPOSURES)}
    dark = {t: tuple(frames(0.0, t, 2, 1000 + n)) for n, t in enumerate(EXPOSURES)}
    return measure_characteristics(lit, dark)


def test_photon_transfer_gives_the_gain(found):
    assert found.gain == pytest.approx(3.3, rel=0.02)


def test_dark_frames_give_read_noise_and_dark_current(found):
    """At 60 ms, 2.4 electrons of dark current add to its variance, of 49: 2.4 % of it."""
    assert found.read_noise**2 == pytest.approx(49.0 + 0.06 * 40, rel=0.02)
    assert found.dark_current == pytest.approx(40.0, rel=0.02)


def test_the_mean_is_linear_and_ends_at_the_well(found):
    assert found.linearity_error < 0.001
    assert found.rate == pytest.approx(RATE, rel=0.02)
    # The variance begins to fall a few standard deviations of shot noise below the well.
    assert 0.92 * 12_000 < found.saturation_capacity < 12_000


def test_averages_give_prnu_and_dsnu(found):
    """16 frames, of which temporal noise leaves 61 electrons² to be told from 3,600 of PRNU."""
    lit, dark = frames(RATE, 1.5, 16, 7), frames(0.0, 1.5, 16, 8)
    spread = uniformity(lit, dark, found.gain)
    assert spread.prnu == pytest.approx(0.01, rel=0.02)
    assert spread.dsnu == pytest.approx(2.5, rel=0.02)


def test_fixed_patterns_are_not_taken_for_noise():
    """A checkerboard of 100 numbers, and normal noise of 2: by numpy's own variance."""
    rng = np.random.default_rng(0)
    board = 100.0 * (np.indices((400, 400)).sum(0) % 2)
    pair = [np.round(board + 500 + 2 * rng.standard_normal(board.shape)) for _ in range(2)]
    mean, variance = pair_moments(*pair)
    assert mean == pytest.approx(550, abs=0.05)
    assert variance == pytest.approx(4 + 1 / 12, rel=0.02)


def test_a_sensor_that_isnt_linear_is_found_out():
    """Numbers that bend by 3 % of the square at the end."""
    bent = {}
    for n, t in enumerate(EXPOSURES[:35]):
        pair = frames(RATE, t, 2, n)
        bent[t] = tuple(np.round(f - 0.03 * (f - 120.0) ** 2 / 3600).astype(int) for f in pair)
    dark = {t: tuple(frames(0.0, t, 2, 1000 + n)) for n, t in enumerate(EXPOSURES[:35])}
    assert measure_characteristics(bent, dark).linearity_error > 0.002


BLACK = np.zeros((8, 8), dtype=int)


@pytest.mark.parametrize(
    ("lit", "dark", "message"),
    [
        ([1.0], [2.0], "light and darkness have other exposures"),
        ([1.0, 2.0], [1.0, 2.0], "2 exposures are given; a curve needs five or more"),
        (range(1, 7), range(1, 7), "fewer than two exposures are below saturation and above dark"),
    ],
)
def test_too_few_frames_are_refused(lit, dark, message):
    with pytest.raises(ValueError, match=message):
        measure_characteristics(
            dict.fromkeys(lit, (BLACK, BLACK)), dict.fromkeys(dark, (BLACK, BLACK))
        )


def test_frames_that_dont_fit_are_refused():
    with pytest.raises(ValueError, match=r"frames of \(8, 8\) and \(4, 8\) are given"):
        pair_moments(BLACK, BLACK[:4])
    with pytest.raises(ValueError, match="1 frames are given; the temporal noise of one is"):
        uniformity([BLACK], [BLACK, BLACK], 1.0)
    with pytest.raises(ValueError, match="the lit frames are 0 numbers above the dark; light"):
        uniformity([BLACK] * 2, [BLACK] * 2, 1.0)
