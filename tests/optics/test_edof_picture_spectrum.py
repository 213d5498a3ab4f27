"""The power spectrum of pictures: measured, modelled and binned."""

import math

import numpy as np
import pytest
import torch

from optics.edof.picture_spectrum import (
    NATURAL_SPECTRUM,
    FrequencyGrid,
    SpectrumModel,
    fit_spectrum_model,
    measure_picture_spectrum,
)


def _random_pictures(spectrum, grid, count, seed):
    """Draw Gaussian periodic pictures of a power spectrum."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((count, grid.size, grid.size))
    return np.fft.irfft2(np.fft.rfft2(white) * np.sqrt(spectrum.numpy()), s=white.shape[1:])


@pytest.mark.parametrize("quarter", [False, True])
def test_shares_make_means_over_all_frequencies(quarter):
    grid = FrequencyGrid(8, quarter)
    fy, fx = np.meshgrid(np.fft.fftfreq(8), np.fft.fftfreq(8), indexing="ij")
    row, column = grid.frequencies()
    values = 1 + row.abs() + 2 * column.abs() ** 2
    assert float((grid.shares() * values).sum()) == pytest.approx(
        float((1 + np.abs(fy) + 2 * np.abs(fx) ** 2).mean())
    )
    assert values.shape == grid.shape


def test_quarter_averages_both_signs():
    grid, values = FrequencyGrid(6), torch.arange(24.0).reshape(6, 4)
    expected = torch.stack([values[0], (values[1] + values[5]) / 2, (values[2] + values[4]) / 2])
    assert torch.equal(grid.select_quarter(values), torch.cat([expected, values[3:4]]))


@pytest.mark.parametrize("size", [3, 2, 0, 7])
def test_grid_needs_an_even_size(size):
    with pytest.raises(ValueError, match="size is"):
        FrequencyGrid(size)


def test_spectrum_of_a_wave_stands_at_its_frequency():
    x = np.arange(16)
    picture = 0.4 + 0.1 * np.cos(2 * np.pi * 3 * x / 16)[None, :] * np.ones((16, 1))
    spectrum = measure_picture_spectrum(picture[None], 16)
    expected = np.zeros((16, 9))
    expected[0, 3] = 0.05**2 * 16**2
    np.testing.assert_allclose(spectrum, expected, atol=1e-12)


@pytest.mark.parametrize("shape", [(9, 13), (16, 16), (20, 50)])
def test_mean_of_the_spectrum_is_the_variance(shape):
    pictures = np.random.default_rng(1).random((3, *shape))
    spectrum = measure_picture_spectrum(pictures, 16)
    mean = float((FrequencyGrid(16).shares() * torch.from_numpy(spectrum)).sum())
    tiled = pictures.var(axis=(1, 2)).mean()
    # The mean of a tile isn't counted, where a picture is cut into tiles.
    assert mean == pytest.approx(tiled, rel=1e-12 if max(shape) <= 16 else 0.02)


def test_smaller_picture_has_the_spectrum_of_its_direct_sum():
    picture = np.random.default_rng(2).random((5, 7))
    spectrum = measure_picture_spectrum(picture[None], 12)
    y, x = np.meshgrid(np.arange(5), np.arange(7), indexing="ij")
    direct = ((picture - picture.mean()) * np.exp(-2j * np.pi * (2 * y + 5 * x) / 12)).sum()
    assert spectrum[2, 5] == pytest.approx(abs(direct) ** 2 / 35)


def test_bad_pictures_are_refused():
    with pytest.raises(ValueError, match="empty"):
        measure_picture_spectrum(np.zeros((0, 4, 4)), 8)
    with pytest.raises(ValueError, match="NaN"):
        measure_picture_spectrum(np.full((1, 4, 4), np.nan), 8)
    with pytest.raises(ValueError, match="rows, columns"):
        measure_picture_spectrum(np.zeros((1, 2, 4, 4)), 8)


def test_fit_finds_the_power_law_of_noisy_values():
    grid = FrequencyGrid(64)
    fy, fx = grid.frequencies()
    radius = torch.hypot(fy, fx)
    law = 1e-3 * torch.where(radius > 0, radius, 1.0) ** -2.2
    law = law * (1 + 0.3 * torch.cos(2 * torch.atan2(fy, fx)))
    noise = np.random.default_rng(3).gamma(20, 1 / 20, grid.shape)
    found = fit_spectrum_model(law * torch.from_numpy(noise)).on_grid(grid)
    ratio = (found / law)[radius > 2 / 64]
    assert float(ratio.log().abs().mean()) < 0.03
    assert float(ratio.mean()) == pytest.approx(1, abs=0.02)
    assert float(found[0, 0]) == 0


def test_fit_refuses_a_spectrum_with_zeros():
    with pytest.raises(ValueError, match="positive"):
        fit_spectrum_model(torch.zeros(8, 5))


def test_natural_spectrum_falls_steeply_and_has_the_variance_of_photographs():
    grid = FrequencyGrid(512)
    spectrum = NATURAL_SPECTRUM.on_grid(grid)
    # Measured on the photographs themselves: .0412.
    assert float((grid.shares() * spectrum).sum()) == pytest.approx(0.0412, rel=0.02)
    slope = math.log(float(spectrum[0, 128] / spectrum[0, 16])) / math.log(8)
    # Natural pictures have power spectra near 1 / f² (D. J. Field, J. Opt. Soc. Am. A 4, 2379).
    assert -2.7 < slope < -1.7


def test_model_needs_rows_of_one_length():
    for rows in ((), ((),), ((1.0,), (1.0, 2.0)), ((1.0,),) * 6):
        with pytest.raises(ValueError, match="coefficients"):
            SpectrumModel(rows)
