"""Restorations with the variance of each pixel: weights, gain, and what can't be a variance."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.signal import fftconvolve

from optics.inverse import build_observation, restore
from optics.inverse.choice import METHODS
from optics.inverse.observation_builder import (
    with_doubted_variance,
    with_variance,
    without_variance,
)
from optics.inverse.restored_image import residual_map
from optics.inverse.variance_gain import VarianceGain, estimate_variance_gain

_SIDE = 120
_MARGIN = 4


def _disk(radius, oversampling=8):
    side = 2 * _MARGIN + 1
    at = (np.arange(side * oversampling) + 0.5) / oversampling - side / 2
    inside = np.hypot(at[:, None], at) < radius
    squares = inside.reshape(side, oversampling, side, oversampling).mean((1, 3))
    return squares / squares.sum()


PSF = _disk(3.3)


def _half_lit_photograph(seed=3, deep=100.0):
    """A scene of patches, half of it in shade that is so many times darker; noise follows light.

    The scene is blurred on its own grid by convolution, without FFT periods, and cut to the frame.
    """
    rng = np.random.default_rng(seed)
    whole = _SIDE + 2 * _MARGIN
    patches = np.kron(rng.uniform(0.2, 1, (16, 16)), np.ones((8, 8)))[:whole, :whole]
    shade = np.where(np.arange(whole) < whole // 2, 1 / deep, 1.0)
    scene = patches * shade
    light = fftconvolve(scene, PSF, mode="valid")
    variance = (0.02 * light) ** 2
    photograph = light + rng.normal(size=light.shape) * np.sqrt(variance)
    cut = slice(_MARGIN, -_MARGIN)
    return photograph, variance, scene[cut, cut]


def _error(restored, scene):
    return float(np.mean((restored.image - scene)[8:-8, 8:-8] ** 2))


def test_weights_are_inverse_deviations_whose_mean_times_variance_is_the_mean_variance():
    image = np.ones((2, 2)) * 10
    variance = np.array([[1.0, 4.0], [9.0, 16.0]])
    seen = build_observation(image, np.ones((1, 1)), variance=variance)
    # The mean variance is 7.5 and the mean deviation 2.5, so that a weight is 3 over the deviation.
    assert seen.weights.numpy() == pytest.approx(np.array([[3, 1.5], [1, 0.75]]))
    assert seen.noise == pytest.approx(np.sqrt(7.5))


def test_the_map_restores_what_is_half_in_shade_better_than_one_noise_for_all():
    photograph, variance, scene = _half_lit_photograph()
    seen = build_observation(photograph, PSF, variance=variance)
    one = build_observation(photograph, PSF, float(np.sqrt(variance.mean())))
    assert _error(restore(one), scene) > 1.07 * _error(restore(seen), scene)


def test_the_residual_with_the_right_map_is_one_and_white():
    photograph, variance, _ = _half_lit_photograph()
    seen = build_observation(photograph, PSF, variance=variance)
    restored = restore(seen, method="total-variation", count=200)
    assert restored.residual == pytest.approx(1, abs=0.15)
    left = residual_map(seen, restored).numpy()
    assert np.nanstd(left[:, 70:]) == pytest.approx(1, abs=0.2)


def test_even_noise_is_restored_as_with_its_deviation():
    photograph, _, _ = _half_lit_photograph(deep=1.0)
    even = build_observation(photograph, PSF, variance=np.full(photograph.shape, 1e-4))
    told = build_observation(photograph, PSF, 1e-2)
    assert even.variance is None
    assert restore(even).image == pytest.approx(restore(told).image, rel=1e-6)


@pytest.mark.parametrize("name", [name for name, one in METHODS.items() if not one.takes_variance])
def test_methods_without_the_map_take_its_root_mean_square(name):
    photograph, variance, _ = _half_lit_photograph()
    told = build_observation(photograph, PSF, float(np.sqrt(variance.mean())))
    seen = build_observation(photograph, PSF, variance=variance)
    if METHODS[name].needs_denoiser:
        own = {"denoise": lambda picture, noise, axes=None: picture}
    else:
        own = {}
    found, wanted = (restore(one, method=name, count=3, **own).image for one in (seen, told))
    assert found == pytest.approx(wanted, rel=1e-4, abs=1e-6)


def test_pixels_of_infinite_variance_and_clipped_ones_are_left_out():
    photograph, variance, _ = _half_lit_photograph()
    wrong = np.zeros(photograph.shape, dtype=bool)
    wrong[40:44, 80:84] = True
    spoilt = np.where(wrong, 50.0, photograph)
    unknown = np.where(wrong, np.inf, variance)
    clean = restore(build_observation(photograph, PSF, variance=variance)).image
    for clipped in (None, wrong):
        given = spoilt if clipped is None else np.where(wrong, 0.0, photograph)
        seen = build_observation(given, PSF, variance=unknown, clipped=clipped)
        assert np.abs(restore(seen).image - clean)[20:60, 60:100].max() < 0.5
        assert np.isnan(residual_map(seen, restore(seen)).numpy()[wrong]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: v[:-1], r"variance is \(119, 120\) and image \(120, 120\)"),
        (lambda v: np.where(v > 0, np.nan, v), "variance is NaN at 14400 pixels"),
        (
            lambda v: np.where(np.arange(v.size).reshape(v.shape), v, 0),
            "at 1 pixels not above 0",
        ),
        (lambda v: -v, "at 14400 pixels not above 0"),
        (lambda v: np.full_like(v, np.inf), "variance is infinite at every pixel that is used"),
    ],
)
def test_what_is_no_variance_is_named(change, message):
    photograph, variance, _ = _half_lit_photograph()
    with pytest.raises(ValueError, match=message):
        build_observation(photograph, PSF, variance=change(variance))


def test_noise_and_variance_exclude_each_other():
    with pytest.raises(ValueError, match=r"noise is 0.1 and variance is given too"):
        build_observation(np.ones((9, 9)), PSF, 0.1, variance=np.ones((9, 9)))


def test_noise_that_the_map_doesnt_explain_makes_it_more_even():
    photograph, variance, _ = _half_lit_photograph()
    seen = build_observation(torch.from_numpy(photograph), PSF)
    whole, tenth = (
        with_doubted_variance(seen, torch.from_numpy(variance * share)) for share in (1, 0.01)
    )
    assert whole.noise == pytest.approx(np.sqrt(variance.mean()))
    assert tenth.noise == pytest.approx(seen.noise)
    assert tenth.variance is None or tenth.weights.max() < whole.weights.max() / 2


def test_the_gain_is_estimated_with_its_sign():
    photograph, variance, _ = _half_lit_photograph()
    seen = build_observation(torch.from_numpy(photograph), PSF, variance=torch.from_numpy(variance))

    def solve(observation, weight):
        return restore(observation, method="total-variation", weight=weight)

    gain = estimate_variance_gain(seen, solve, torch.Generator().manual_seed(0))
    assert gain.light > 0.3
    assert estimate_variance_gain(without_variance(seen), solve, torch.Generator()) == VarianceGain(
        0, 0
    )


def test_the_noise_for_all_is_the_root_mean_square_of_the_map():
    photograph, variance, _ = _half_lit_photograph()
    seen = build_observation(torch.from_numpy(photograph), PSF)
    back = without_variance(with_variance(seen, torch.from_numpy(variance)))
    assert back.weights is None
    assert back.noise == pytest.approx(np.sqrt(variance.mean()))
