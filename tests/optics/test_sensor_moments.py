"""Mean and variance maps against sums by scipy.stats, and against frames drawn by chance."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats as st
import torch
from judges.sensor import judged

from optics.camera import Sensor
from optics.sensor import fixed_pattern, moments, sample_frame

WELL_FIRST = Sensor(
    shape=(8, 8), bits=8, full_well=150.0, gain=0.9, read_noise=0.8, black_level=3.0,
    dark_current=0.0,
)  # fmt: skip
CONVERTER_FIRST = replace(WELL_FIRST, bits=6, full_well=230.0, gain=2.7, black_level=0.3)
LIGHT = np.array([0.0, 0.02, 0.3, 1.7, 6.0, 9.99, 10.01, 41.3, 127.0, 149.0, 163.0, 172.0, 220.0])
CHAINS = list(itertools.product(("none", "Gaussian", "skewed", "Poisson"), *[(False, True)] * 3))


@pytest.mark.parametrize("sensor", [WELL_FIRST, CONVERTER_FIRST])
@pytest.mark.parametrize(("shot", "clipping", "read", "quantised"), CHAINS)
def test_moments_are_the_sums_over_all_that_can_happen(sensor, shot, clipping, read, quantised):
    """To 1e-4 of themselves, or of a thousandth of a squared step."""
    mean, variance = moments(
        torch.from_numpy(LIGHT), 1.0, sensor,
        shot=shot, clipping=clipping, read_noise=read, quantisation=quantised,
    )  # fmt: skip
    truth = np.array([judged(x, sensor, shot, clipping, read, quantised) for x in LIGHT])
    assert mean.numpy() == pytest.approx(truth[:, 0], rel=1e-4, abs=2e-5)
    assert variance.numpy() == pytest.approx(truth[:, 1], rel=1e-4, abs=2e-4)


@pytest.mark.parametrize(("read", "quantised"), [(True, True), (False, True), (True, False)])
def test_offsets_of_pixels_are_tabulated_exactly(read, quantised):
    sensor = replace(CONVERTER_FIRST, dsnu=1.5, shape=(16, 16), black_level=1.0)
    light = torch.linspace(0, 200, 256, dtype=torch.float64).reshape(16, 16)
    mean, variance = moments(light, 1.0, sensor, read_noise=read, quantisation=quantised)
    offset = fixed_pattern(sensor).offset
    for row, column in [(0, 0), (0, 9), (3, 3), (8, 15), (15, 15)]:
        truth = judged(
            float(light[row, column]), sensor, "Poisson", True, read, quantised,
            float(offset[row, column]),
        )  # fmt: skip
        assert float(mean[row, column]) == pytest.approx(truth[0], rel=1e-4, abs=2e-5)
        assert float(variance[row, column]) == pytest.approx(truth[1], rel=1e-4, abs=2e-4)


def test_dark_current_and_response_change_the_electrons():
    """Without clipping and rounding: Poisson's mean is its variance."""
    sensor = replace(WELL_FIRST, dark_current=5.0, prnu=0.05, shape=(32, 32))
    light = torch.full((32, 32), 100.0)
    mean, variance = moments(light, 2.0, sensor, clipping=False, quantisation=False)
    gain = fixed_pattern(sensor).response.to(torch.float64)
    assert torch.allclose(mean, 100 * gain + 10, rtol=1e-12)
    assert torch.allclose(variance, 100 * gain + 10 + 0.8**2, rtol=1e-12)
    plain, _ = moments(light, 2.0, sensor, fixed_pattern=False, dark_current=False, shot="none",
                       clipping=False, quantisation=False)  # fmt: skip
    assert torch.equal(plain, light.double())


def test_frames_have_the_moments_that_are_told():
    """At the knee, with everything on, within five standard errors of 4,000 frames."""
    sensor = replace(WELL_FIRST, dsnu=1.0, prnu=0.02, dark_current=3.0, shape=(4, 8))
    light = torch.linspace(0, 170, 32).reshape(4, 8)
    generator = torch.Generator().manual_seed(1)
    frames = torch.stack(
        [sample_frame(light, 0.5, sensor, generator) for _ in range(4000)]
    ).double()
    electrons = (frames - sensor.black_level) * sensor.gain
    mean, variance = moments(light, 0.5, sensor)
    error = (electrons.mean(0) - mean).abs() / (variance / 4000).sqrt()
    assert float(error.max()) < 5
    fourth = ((electrons - electrons.mean(0)) ** 4).mean(0)
    error = (electrons.var(0) - variance).abs() / ((fourth - variance**2) / 4000).sqrt()
    assert float(error.max()) < 5


def test_so_much_light_that_no_table_reaches_it():
    """Nothing clips: shot noise, read noise and a twelfth of a squared step."""
    light = torch.tensor([1e6, 3e9], dtype=torch.float64)
    mean, variance = moments(light, 1.0, Sensor(dark_current=0.0), clipping=False)
    assert torch.allclose(mean, light, rtol=1e-9)
    assert torch.allclose(variance, light + 2.4**2 + 2.6**2 / 12, rtol=1e-6)


@pytest.mark.parametrize("bits", [14, 16])
def test_a_deep_well_is_tabulated_in_pieces(bits):
    """500,000 electrons, or a converter that ends before them: darkness, between, and the knee."""
    sensor = Sensor(bits=bits, full_well=5e5, gain=20.0, read_noise=15.0, black_level=200.0,
                    dark_current=0.0)  # fmt: skip
    light = np.array([3.0, 1e5, 131_000.0, 131_200.0, 3e5, 323_000.0, 324_000.0, 499_300.0, 6e5])
    mean, variance = moments(torch.from_numpy(light), 1.0, sensor)
    truth = np.array([by_normal(x, sensor) for x in light[1:]])
    assert mean.numpy()[1:] == pytest.approx(truth[:, 0], rel=1e-6)
    assert variance.numpy()[1:] == pytest.approx(truth[:, 1], rel=2e-3, abs=1e-3)
    assert float(mean[0]) == pytest.approx(judged(3.0, sensor, "Poisson", True, True, True)[0])


def by_normal(light, sensor):
    """Of so many electrons that they are normal: integrals over them, well, noise and rounding."""
    held = light + math.sqrt(light) * np.linspace(-8, 8, 8001)
    weights = st.norm.pdf(np.linspace(-8, 8, 8001))
    weights /= weights.sum()
    counts = np.minimum(held, sensor.full_well)
    top = (2**sensor.bits - 1 - sensor.black_level) * sensor.gain
    noise = np.linspace(-8, 8, 161)
    shares = st.norm.pdf(noise) / st.norm.pdf(noise).sum()
    read = np.minimum(counts[:, None] + sensor.read_noise * noise, top)
    both = weights[:, None] * shares
    mean = float((both * read).sum())
    rounding = sensor.gain**2 / 12 * float((both * (read < top)).sum())
    return mean, float((both * (read - mean) ** 2).sum()) + rounding


def test_a_burnt_pixel_doesnt_vary():
    mean, variance = moments(torch.tensor([1e12]), 1.0, WELL_FIRST, read_noise=False)
    number = round(150 / 0.9 + 3)
    assert float(mean) == pytest.approx((number - 3) * 0.9)
    assert float(variance) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("light", "exposure", "options", "message"),
    [
        (torch.tensor([1.0, math.nan]), 1.0, {}, "electrons has 1 NaN or infinite values of 2"),
        (torch.ones(2), 0.0, {}, "exposure is 0 s; it must be positive"),
        (torch.ones(2), 1.0, {"shot": "Poison"}, "shot is 'Poison'; choose none, Gaussian"),
    ],
)
def test_what_makes_no_sense_is_refused_by_moments_and_draws(light, exposure, options, message):
    for function, more in ((moments, ()), (sample_frame, (torch.Generator(),))):
        with pytest.raises(ValueError, match=message):
            function(light, exposure, WELL_FIRST, *more, **options)


def test_uneven_pixels_need_the_whole_sensor():
    with pytest.raises(ValueError, match=r"electrons is \(4, 4\); .* the whole sensor's, \(8, 8\)"):
        moments(torch.ones(4, 4), 1.0, replace(WELL_FIRST, prnu=0.01))
