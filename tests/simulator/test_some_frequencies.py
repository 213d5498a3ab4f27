"""Sums over some of a picture's frequencies, against sums over all of them."""

import math

import numpy as np
import pytest
import torch

from optics.formation import rfft2_frequencies, spectrum_of_samples
from optics.plane import Plane
from simulator.probing.sampled_frequencies import SampledFrequencies

PLANE = Plane((96, 128), (5e-6, 5e-6))


def pictures():
    rng = np.random.default_rng(4)
    y, x = np.mgrid[:96, :128]
    noise = rng.random((96, 128))
    yield noise
    yield np.cumsum(np.cumsum(noise - noise.mean(), 0), 1)
    yield (x // 8 % 2).astype(float)
    yield np.exp(-((y - 40) ** 2 + (x - 70) ** 2) / 3)


def gains():
    """By frequency in cycles per metre: isotropic or not."""
    yield lambda ky, kx: np.hypot(ky, kx) / 1e5
    yield lambda ky, kx: (kx / 1e5) ** 2
    yield lambda ky, kx: np.exp(-np.abs(ky) / 3e4)


@pytest.mark.parametrize("gain", list(gains()))
@pytest.mark.parametrize("picture", list(pictures()))
def test_filtered_pictures_have_the_norm_that_some_frequencies_tell(picture, gain):
    squared = spectrum_of_samples(torch.from_numpy(picture)).abs().square()
    some = SampledFrequencies.of(squared, PLANE)
    told = math.sqrt((some.represented_power(squared, PLANE) * gain(some.ky, some.kx) ** 2).sum())
    fy, fx = (np.fft.fftfreq(n, 5e-6) for n in PLANE.shape)
    spectrum = np.fft.fft2(picture - picture.mean()) * gain(fy[:, None], fx[None])
    assert told == pytest.approx(np.linalg.norm(np.fft.ifft2(spectrum)), rel=0.1)


def test_there_are_few_of_them_and_none_of_an_even_picture():
    squared = spectrum_of_samples(torch.rand(96, 128)).abs().square()
    assert len(SampledFrequencies.of(squared, PLANE).ky) < 1500
    even = spectrum_of_samples(torch.ones(96, 128)).abs().square()
    even[0, 1:] = even[1:] = 0.0
    assert not len(SampledFrequencies.of(even, PLANE).ky)


def test_finer_ones_look_alike_on_pixels_and_are_dimmed_by_them():
    squared = spectrum_of_samples(torch.rand(96, 128)).abs().square()
    some = SampledFrequencies.of(squared, PLANE)
    both, count = some.with_aliases(PLANE), len(some.ky)
    assert len(both.ky) == 3 * count
    away = (both.ky[count : 2 * count] - some.ky) * 5e-6
    assert np.abs(np.abs(away) - 1).max() < 1e-9
    assert (np.abs(both.ky[count : 2 * count]) * 5e-6 >= 0.5 - 1e-9).all()
    assert (both.share[count:] <= np.tile(some.share, 2) * (1 + 1e-9)).all()
    fy, fx = rfft2_frequencies(PLANE)
    assert np.abs(some.ky).max() <= float(fy.abs().max())
    assert np.abs(some.kx).max() <= float(fx.max())
