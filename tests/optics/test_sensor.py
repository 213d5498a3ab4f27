"""The sensor in the quantities of EMVA 1288; statistics within five standard errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions

from optics.accuracy import MachineSpeed
from optics.camera import Sensor
from optics.plane import Plane
from optics.sensor import (
    PixelIntegration,
    expose,
    integrate_pixels,
    pixel_margin,
    pixel_transfer,
    sample_pixels,
)

SENSOR = Sensor(
    shape=(64, 64), bits=12, full_well=9000.0, gain=2.5, read_noise=3.0, dark_current=4.0,
    black_level=100.0,
)  # fmt: skip
SAMPLES = 200_000


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def frame(electrons: float, sensor: Sensor = SENSOR, seed: int = 0, exposure=1.0, **flags):
    rate = torch.full((SAMPLES,), electrons / exposure, dtype=torch.float64)
    return expose(rate, exposure, sensor, seeded(seed), **flags).to(torch.float64)


def test_the_photon_transfer_curve_has_the_slope_of_the_gain():
    """Janesick: variance = mean / gain + floor, in digital numbers."""
    points = [frame(n, seed=n, dark_current=False) for n in (100, 400, 900, 1800, 3600)]
    mean = [float(p.mean()) - 100 for p in points]
    variance = [float(p.var()) for p in points]
    slope, floor = np.polyfit(mean, variance, 1)
    # A variance of N samples is known to sqrt(2 / N); the steepest lever is the last point.
    assert slope == pytest.approx(1 / 2.5, rel=5 * math.sqrt(2 / SAMPLES) * 1.5)
    assert floor == pytest.approx((3.0 / 2.5) ** 2 + 1 / 12, abs=5)


@pytest.mark.parametrize("electrons", [0.0, 1.0, 1000.0])
def test_mean_and_variance_are_those_of_every_stage_added_up(electrons):
    """Poisson(signal + dark) + read², over gain², and a twelfth for quantisation."""
    exposure = 5.0
    numbers = frame(electrons, exposure=exposure)
    total = electrons + 4.0 * exposure
    variance = (total + 3.0**2) / 2.5**2 + 1 / 12
    assert float(numbers.mean()) == pytest.approx(
        100 + total / 2.5, abs=5 * math.sqrt(variance / SAMPLES)
    )
    kurtosis_margin = 5 * math.sqrt(3 / SAMPLES)
    assert float(numbers.var()) == pytest.approx(variance, rel=kurtosis_margin)


def test_read_noise_alone_has_its_standard_deviation():
    numbers = frame(0.0, shot_noise=False, dark_current=False)
    assert float(numbers.std()) == pytest.approx(math.sqrt((3 / 2.5) ** 2 + 1 / 12), rel=0.01)


def test_without_noise_a_frame_is_the_rounded_mean():
    """round(electrons / gain + black): written out for some values."""
    rate = torch.tensor([0.0, 1.0, 2.4, 100.0, 5000.0])
    quiet = {"shot_noise": False, "read_noise": False, "dark_current": False}
    numbers = expose(rate, 2.0, SENSOR, seeded(), **quiet)
    assert numbers.tolist() == [100, 101, 102, 180, 3700]
    assert numbers.dtype == torch.int32
    again = expose(rate, 2.0, SENSOR, seeded(99), **quiet)
    assert torch.equal(numbers, again)


def test_dark_current_adds_its_mean():
    quiet = {"shot_noise": False, "read_noise": False}
    assert frame(0.0, exposure=10.0, **quiet)[0] == 100 + 40 / 2.5


def test_a_full_well_clips_before_the_converter_and_the_converter_after_it():
    """9000 e- / 2.5 + 100 = 3700 below 4095; a deep well ends at 4095."""
    quiet = {"read_noise": False, "dark_current": False}
    assert (frame(1e6, **quiet) == 3700).all()
    deep = replace(SENSOR, full_well=1e6)
    assert (frame(1e7, deep, **quiet) == 4095).all()
    assert (frame(1e6) >= SENSOR.full_scale).float().mean() > 0.999


def test_numbers_are_never_negative():
    sensor = replace(SENSOR, black_level=0.0)
    assert float(frame(0.0, sensor).min()) == 0


def test_the_seed_alone_decides_the_frame():
    assert torch.equal(frame(50.0, seed=4), frame(50.0, seed=4))
    assert not torch.equal(frame(50.0, seed=4), frame(50.0, seed=5))


@pytest.mark.parametrize("exposure", [0.0, -1.0, math.nan, math.inf])
def test_an_exposure_that_is_not_positive_is_refused(exposure):
    with pytest.raises(ValueError, match=r"exposure is .* s; it must be positive"):
        expose(torch.ones(2, 2), exposure, SENSOR, seeded())


@pytest.mark.parametrize("flag", [True, False])
def test_light_that_is_not_finite_is_refused(flag):
    with pytest.raises(ValueError, match=r"rate has 1 NaN or infinite values of 2"):
        expose(torch.tensor([1.0, math.nan]), 1.0, SENSOR, seeded(), shot_noise=flag)


def cosine(n: int, factor: int, cycles_per_pixel: float, phase: float) -> torch.Tensor:
    x = positions(n * factor, 1 / factor)
    return torch.from_numpy(1 + 0.8 * np.cos(2 * np.pi * cycles_per_pixel * x + phase))


@pytest.mark.parametrize("n", [50, 51])
@pytest.mark.parametrize("factor", [1, 2, 3, 5])
@pytest.mark.parametrize(("dtype", "bound"), [(torch.float64, 1e-8), (torch.float32, 3e-6)])
def test_pixels_integrate_a_fringe_exactly(n, factor, dtype, bound):
    """The mean of cos over a pixel of width 1 at x is sinc(f) cos(2 pi f x); units: samples."""
    fy, fx = 0.13 * factor, 0.31 * factor
    light = cosine(n, factor, fy, 0.3)[:, None] * cosine(n, factor, fx, 1.0)[None, :]
    pixels = integrate_pixels(light.to(dtype), factor)
    x = positions(n, 1.0)
    rows = 1 + 0.8 * np.sinc(fy) * np.cos(2 * np.pi * fy * x + 0.3)
    columns = 1 + 0.8 * np.sinc(fx) * np.cos(2 * np.pi * fx * x + 1.0)
    margin = pixel_margin(factor)
    inner = slice(margin, n - margin)
    error = np.abs(pixels.numpy() / factor**2 - np.outer(rows, columns))[inner, inner]
    assert pixels.shape == (n, n)
    assert error.size > 0
    assert error.max() <= bound


@pytest.mark.parametrize("shape", [(40, 51), (37, 18)])
@pytest.mark.parametrize("cycles", [(0.3, 0.97), (1.13, 0.51)])
@pytest.mark.parametrize("tol", [1e-3, 1e-5, 1e-9])
def test_parts_of_samples_per_pixel_integrate_a_fringe(shape, cycles, tol):
    """Of the finest fringe along each axis; the truth is as for whole numbers of samples."""
    pitch, centre = (2e-6, 3e-6), (1e-5, -4e-5)
    pixels = Plane(shape, pitch, centre)
    cutoff = (cycles[0] / pitch[0], cycles[1] / pitch[1])
    integral = PixelIntegration(pixels, cutoff, tol=tol)
    samples, truth = [], []
    for axis in (0, 1):
        turn = 2 * np.pi * cutoff[axis]
        place = integral.plane.coordinates(axis).numpy() - centre[axis]
        middle = pixels.coordinates(axis).numpy() - centre[axis]
        samples.append(1 + 0.8 * np.cos(turn * place + 0.4))
        truth.append(1 + 0.8 * np.sinc(cycles[axis]) * np.cos(turn * middle + 0.4))
    per_pixel = integral.samples_per_pixel
    found = integral(torch.from_numpy(np.outer(*samples))).numpy() / per_pixel
    error = np.linalg.norm(found - np.outer(*truth)) / np.linalg.norm(np.outer(*truth))
    assert error <= max(integral.error, 1e-12)
    assert integral.error <= tol
    # No more samples than half as many again as Nyquist's rate takes, and a margin.
    assert per_pixel <= np.prod([max(1.0, 2 * 1.5 * c + 1 / 16) for c in cycles])
    assert found.shape == shape


@pytest.mark.parametrize("cycles", [0.3, 1.02, 5.0, 90.0])
@pytest.mark.parametrize("tol", [1e-3, 1e-5, 1e-9])
def test_weights_of_a_pixels_samples_do_not_amplify_rounding(cycles, tol):
    """Even light of 1 per sample has weights that sum to the samples; hardly more in size."""
    integral = PixelIntegration(Plane((3, 20), (1.0, 1.0)), (0.2, cycles), tol=tol)
    weights = integral._weights[1]
    sums = weights.weights.sum(1) / float(weights.factor)
    assert torch.allclose(sums, torch.ones_like(sums), atol=tol)
    assert float(weights.weights.abs().sum(1).max()) <= 20 * float(weights.factor)


def test_the_price_of_weights_is_told_where_they_are_found_and_once():
    """Of light that no other test asks for: each fit of the first plan is priced, and none of the
    second."""
    pixels, cutoff, speed = Plane((40, 40), (1.0, 1.0)), 0.7123, MachineSpeed()
    first, again = (PixelIntegration(pixels, cutoff, tol=3e-7) for _ in range(2))
    weights = first._weights[0]
    assert max(weights.fits) == weights.reach
    assert len(weights.fits) > 8
    dearer = first.planning_seconds(speed) - again.planning_seconds(speed)
    assert dearer == pytest.approx(weights.fit_seconds(speed))
    assert dearer > again.planning_seconds(speed)


def test_pixels_of_a_batch_are_those_of_each_picture():
    light = torch.from_numpy(np.random.default_rng(0).random((2, 3, 40, 44)))
    together = integrate_pixels(light, 4)
    assert together.shape == (2, 3, 10, 11)
    assert torch.allclose(together[1, 2], integrate_pixels(light[1, 2], 4), atol=1e-14)


def test_gradients_pass_through_pixels():
    light = torch.rand(6, 8, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: integrate_pixels(x, 2), (light,))


@pytest.mark.parametrize("factor", [1, 2, 3, 4])
@pytest.mark.parametrize("n", [4, 5])
def test_sampling_keeps_the_origin(n, factor):
    light = torch.zeros(n * factor, (n + 1) * factor)
    light[n * factor // 2, (n + 1) * factor // 2] = 1
    pixels = sample_pixels(light, factor)
    assert pixels.shape == (n, n + 1)
    assert pixels[n // 2, (n + 1) // 2] == 1
    assert pixels.sum() == 1


def test_a_pixels_transfer_function_is_the_spectrum_of_a_square():
    """The DFT of a centred run of `factor` samples tends to it: (2k+1)-sample Dirichlet kernel."""
    factor, n = 31, 31 * 8
    square = np.zeros(n)
    square[np.arange(-15, 16)] = 1 / factor
    truth = np.fft.rfft(square).real[:20]
    assert np.allclose(pixel_transfer(n, n, factor)[0, :20].numpy(), truth, atol=2e-3)
    assert pixel_transfer(8, 8, 1)[0, 0] == 1
