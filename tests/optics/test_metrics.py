import math

import numpy as np
import pytest
import torch
from judges import natural_image
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from optics.metrics import (
    crop_central_share,
    efficiency,
    psnr,
    relative_error,
    speckle_contrast,
    spectral_angle,
    ssim,
)


def test_efficiency_is_the_light_where_the_target_is():
    """By hand: the target exceeds 2 % of its peak in the first row alone."""
    target = np.array([[1.0, 0.025], [0.02, 0.0]])
    psf = np.array([[0.3, 0.2], [0.4, 0.1]])
    assert efficiency(psf, target) == pytest.approx(0.5)
    assert efficiency(psf, target, total=2.0) == pytest.approx(0.25)


def test_speckle_contrast_is_the_spread_over_the_mean_where_the_target_is_bright():
    """By hand: ratios 1 and 3 where the target exceeds half its peak: std 1, mean 2."""
    target = np.array([[2.0, 4.0, 2.0, 0.1]])
    psf = np.array([[99.0, 4.0, 99.0, 99.0]])
    assert speckle_contrast(psf, target) == 0
    target, psf = np.array([[4.0, 3.0, 2.0]]), np.array([[4.0, 9.0, 99.0]])
    assert speckle_contrast(psf, target) == pytest.approx(0.5)


@pytest.mark.parametrize("spread", [0.0, 0.04])
def test_the_cameras_noise_is_no_speckle(spread):
    """Drawn photons and read noise on a PSF of a known contrast; on an even one little is left."""
    rng = np.random.default_rng(6)
    target = rng.uniform(2, 4, (120, 120))
    light = 200 * target * (1 + spread * rng.standard_normal(target.shape))
    seen = rng.poisson(light) + 3 * rng.standard_normal(target.shape)
    assert speckle_contrast(seen, target) > spread + 0.015
    assert speckle_contrast(seen, target, light + 9) == pytest.approx(spread, abs=0.006)


def test_a_scale_changes_no_contrast():
    rng = np.random.default_rng(0)
    psf, target = rng.random((5, 5)), 1 + rng.random((5, 5))
    assert speckle_contrast(7 * psf, target) == pytest.approx(speckle_contrast(psf, 3 * target))


def test_relative_error_has_no_fitted_scale():
    assert relative_error(np.array([3.0, 4.0]) * 1.5, np.array([3.0, 4.0])) == pytest.approx(0.5)


def test_psnr_equals_scikit_images():
    rng = np.random.default_rng(1)
    a, b = rng.random((20, 30)), rng.random((20, 30))
    assert psnr(a, b) == pytest.approx(peak_signal_noise_ratio(b, a, data_range=1.0))
    assert psnr(9 * a, 9 * b, peak=9.0) == pytest.approx(psnr(a, b))
    assert psnr(a, a) == math.inf


@pytest.mark.parametrize("shape", [(48, 64), (33, 41), (11, 11)])
@pytest.mark.parametrize("data_range", [1.0, 255.0])
def test_ssim_equals_scikit_images_where_the_window_fits(shape, data_range):
    """scikit-image leaves out the same 5 pixels at the border with the paper's settings."""
    image = natural_image(*shape, seed=2) * data_range
    noisy = image + np.random.default_rng(3).normal(0, 0.1 * data_range, shape)
    truth = structural_similarity(
        image, noisy, data_range=data_range, gaussian_weights=True, sigma=1.5,
        use_sample_covariance=False,
    )  # fmt: skip
    assert 0.01 < truth < 0.95
    assert ssim(noisy, image, data_range) == pytest.approx(truth, abs=1e-9)
    assert ssim(image, image, data_range) == pytest.approx(1.0)


def test_tensors_and_arrays_are_judged_alike():
    a, b = natural_image(20, 20, 4), natural_image(20, 20, 5)
    assert ssim(torch.from_numpy(a), torch.from_numpy(b)) == ssim(a, b)
    assert psnr(torch.from_numpy(a), torch.from_numpy(b)) == psnr(a, b)


def test_the_central_part_is_cut_alike_on_both_sides():
    """90 % of 20 x 40 leaves out 1 row and 2 columns at each edge."""
    image = torch.arange(800).reshape(20, 40)
    assert torch.equal(crop_central_share(image), image[1:19, 2:38])
    assert torch.equal(crop_central_share(image, 1.0), image)


@pytest.mark.parametrize("figure", [efficiency, speckle_contrast, relative_error, psnr, ssim])
def test_pictures_of_different_shapes_are_refused(figure):
    """(12, 1) would broadcast silently."""
    with pytest.raises(ValueError, match=r"\(12, 1\).*\(12, 12\)"):
        figure(torch.ones(12, 1), torch.ones(12, 12))


@pytest.mark.parametrize("figure", [efficiency, speckle_contrast, relative_error, psnr, ssim])
def test_values_that_are_not_finite_are_refused(figure):
    bad = torch.ones(12, 12)
    bad[3, 3] = math.nan
    with pytest.raises(ValueError, match=r"has 1 NaN or infinite values of 144"):
        figure(bad, torch.ones(12, 12))
    with pytest.raises(ValueError, match=r"has 1 NaN or infinite values of 144"):
        figure(torch.ones(12, 12), bad)


@pytest.mark.parametrize("figure", [efficiency, speckle_contrast])
def test_an_empty_target_is_refused(figure):
    with pytest.raises(ValueError, match=r"target .* positive"):
        figure(torch.ones(4, 4), torch.zeros(4, 4))


def test_a_truth_of_zero_is_refused():
    with pytest.raises(ValueError, match=r"reference is zero"):
        relative_error(torch.ones(4), torch.zeros(4))


def test_ranges_and_shares_that_make_no_sense_are_refused():
    image = torch.ones(12, 12)
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match=r"peak is .* positive"):
            psnr(image, image, bad)
        with pytest.raises(ValueError, match=r"data_range is .* positive"):
            ssim(image, image, bad)
        with pytest.raises(ValueError, match=r"total is .* positive"):
            efficiency(image, image, bad)
        with pytest.raises(ValueError, match=r"share is .* 0 to 1"):
            crop_central_share(image, bad)
    with pytest.raises(ValueError, match=r"share is 1.5"):
        crop_central_share(image, 1.5)
    with pytest.raises(ValueError, match=r"\(10, 12\).* 11"):
        ssim(torch.ones(10, 12), torch.ones(10, 12))


def test_no_light_at_all_has_no_contrast():
    with pytest.raises(ValueError, match=r"psf .* no light"):
        speckle_contrast(torch.zeros(4, 4), torch.ones(4, 4))


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 30.0, 90.0, 179.0, 180.0])
def test_spectral_angle_is_the_angle_that_the_spectra_were_turned_by(degrees):
    """Two bands, turned in their plane; brightness of either picture doesn't count."""
    along = np.radians(25.0)
    truth = 3 * np.array([np.cos(along), np.sin(along)])[:, None, None] * np.ones((2, 2, 3))
    turned = np.radians(25.0 + degrees)
    seen = 0.2 * np.array([np.cos(turned), np.sin(turned)])[:, None, None] * np.ones((2, 2, 3))
    assert spectral_angle(seen, truth) == pytest.approx(degrees, rel=1e-6, abs=1e-12)
    assert spectral_angle(torch.from_numpy(seen), torch.from_numpy(truth)) == pytest.approx(
        degrees, rel=1e-6, abs=1e-12
    )


def test_spectral_angle_is_a_mean_over_bright_pixels():
    """By hand: 90 and 45 degrees; the third pixel's spectrum has a length of 0.1 only."""
    truth = np.array([[[1.0, 1.0, 0.1]], [[0.0, 0.0, 0.0]]])
    seen = np.array([[[0.0, 2.0, 0.0]], [[5.0, 2.0, 1.0]]])
    assert spectral_angle(seen, truth) == pytest.approx((90 + 45) / 2)
    assert spectral_angle(seen, truth, least_norm=0.05) == pytest.approx((90 + 45 + 90) / 3)
    dark = np.zeros_like(truth)
    assert spectral_angle(dark, truth) == pytest.approx(90)


@pytest.mark.parametrize(
    ("seen", "truth", "least", "words"),
    [
        (np.ones((2, 3, 3)), np.ones((2, 3, 4)), 0.1, "one shape"),
        (np.ones((3, 3)), np.ones((3, 3)), 0.1, "bands, rows, columns"),
        (np.full((2, 1, 1), np.nan), np.ones((2, 1, 1)), 0.1, "NaN"),
        (np.ones((2, 1, 1)), np.zeros((2, 1, 1)), 0.1, "longer than 0.1"),
        (np.ones((2, 1, 1)), np.ones((2, 1, 1)), -1.0, "least_norm is -1"),
    ],
)
def test_spectral_angle_refuses_in_words(seen, truth, least, words):
    with pytest.raises(ValueError, match=words):
        spectral_angle(seen, truth, least)
