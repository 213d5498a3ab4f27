"""Error maps of spectral restorations: scaling, shapes, alike bands by hand, and bad input."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from optics.inverse import build_mosaic_observation
from optics.multispectral import predict_errors, restore_spectra
from optics.multispectral.error_map import error_features, estimate_error_map, find_alike_bands

BAYER = ("RG", "GB")
RESPONSE = np.array([[0.02, 0.05, 0.8, 0.9], [0.1, 0.9, 0.2, 0.1], [0.9, 0.1, 0.02, 0.03]])
SPECTRA = np.random.default_rng(1).random((30, 4)).astype(np.float32)
SIDE = 24
NOISE = 0.01


def psfs():
    """Two dots for each band, whose distance grows with the band."""
    stack = np.zeros((4, 9, 9))
    for band in range(4):
        stack[band, 4, band + 1] = stack[band, 4 - band, 4] = 0.5
    return stack


def observed(unit=1.0, noise=NOISE, numpy=True):
    rng = np.random.default_rng(2)
    raw = gaussian_filter(rng.random((SIDE, SIDE)), 2) * unit
    raw[:, SIDE // 2 :] *= 0.05
    raw = raw.astype(np.float32)
    return build_mosaic_observation(
        raw if numpy else torch.from_numpy(raw), BAYER, psfs(), response=RESPONSE,
        noise=noise * unit, border="periodic",
    )  # fmt: skip


@pytest.fixture(scope="module")
def restored():
    return restore_spectra(observed(), SPECTRA, iterations=10, adapts=False)


def test_has_the_kind_and_shape_of_the_picture(restored):
    found = estimate_error_map(observed(), restored, SPECTRA)
    assert isinstance(found.half_width, np.ndarray)
    assert found.half_width.dtype == np.float32
    assert found.half_width.shape == (4, SIDE, SIDE)
    assert np.isfinite(found.half_width).all()
    assert (found.half_width > 0).all()


def test_tensors_give_the_same_tensors(restored):
    wanted = estimate_error_map(observed(), restored, SPECTRA).half_width
    tensors = replace(restored, image=torch.from_numpy(restored.image))
    found = estimate_error_map(observed(numpy=False), tensors, torch.from_numpy(SPECTRA))
    assert isinstance(found.half_width, torch.Tensor)
    assert np.allclose(found.half_width.numpy(), wanted, rtol=1e-5)


@pytest.mark.parametrize("unit", [1e-3, 300.0])
def test_widths_follow_the_unit_of_light(restored, unit):
    wanted = estimate_error_map(observed(), restored, SPECTRA).half_width * unit
    scaled = replace(restored, image=restored.image * np.float32(unit))
    found = estimate_error_map(observed(unit), scaled, SPECTRA)
    assert np.allclose(found.half_width, wanted, rtol=1e-4)


def test_is_wider_in_light_than_in_the_dark(restored):
    width = estimate_error_map(observed(), restored, SPECTRA).half_width
    assert width[:, :, 2:8].mean() > 1.5 * width[:, :, 16:22].mean()


def test_more_noise_makes_it_wider(restored):
    less, more = (
        estimate_error_map(observed(noise=noise), restored, SPECTRA).half_width
        for noise in (0.005, 0.05)
    )
    assert (more > less).all()


def test_light_is_smoothed_as_scipy_does(restored):
    features = error_features(observed(), torch.from_numpy(restored.image), SPECTRA)
    scale = np.sqrt((restored.image.astype(float) ** 2).sum(0).mean())
    smooth = gaussian_filter(restored.image, (0, 1, 1), mode="nearest", truncate=3.0)
    wanted = np.log(smooth / scale + 3e-3)
    assert features.scale == pytest.approx(scale, rel=1e-5)
    assert np.allclose(features.logarithms["light"].numpy(), wanted, atol=1e-4)


def test_predicted_share_is_that_of_predict_errors(restored):
    features = error_features(observed(), torch.from_numpy(restored.image), SPECTRA)
    length = np.sqrt((SPECTRA**2).sum(1).mean())
    expected = predict_errors(
        psfs(), RESPONSE, BAYER, SPECTRA, NOISE / features.scale * length, period=64
    )
    wanted = (expected.rms / expected.prior_rms).log().numpy()
    assert np.allclose(features.logarithms["predicted"].flatten().numpy(), wanted, atol=1e-4)


def test_finds_the_bands_that_filters_see_alike(restored):
    # cos(angle) of the last two columns (each letter's pixels: R 1, G 2, B 1) is 0.98, of others
    # below 0.5.
    found = estimate_error_map(
        observed(), restored, SPECTRA, labels=["450 nm", "540 nm", "620 nm", "680 nm"]
    )
    assert found.uncertain_bands == (2, 3)
    assert found.message.startswith("The filters see 620 nm and 680 nm alike: only the PSFs")


def test_says_when_equal_psfs_separate_nothing(restored):
    observation = observed()
    same = replace(observation, psfs=observation.psfs[:1].expand(4, -1, -1))
    assert "don't differ either" in estimate_error_map(same, restored, SPECTRA).message


def test_bands_of_different_filters_are_not_alike():
    assert find_alike_bands(torch.eye(3)[:, None]) == []
    assert find_alike_bands(torch.tensor([[[1.0, 0.0]], [[0.0, 1.0]], [[0.2, 0.0]]])) == [(0, 2)]


def test_neighbours_of_neighbours_are_one_group():
    angles = torch.tensor([0.0, 0.5, 0.25, 1.5])
    filters = torch.stack([angles.cos(), angles.sin()], 1)[:, None]
    assert find_alike_bands(filters) == [(0, 1, 2)]


def test_refuses_what_does_not_fit(restored):
    observation = observed()
    smaller = replace(restored, image=restored.image[:, 1:])
    with pytest.raises(ValueError, match=r"restored is \(4, 23, 24\)"):
        estimate_error_map(observation, smaller, SPECTRA)
    with pytest.raises(ValueError, match=r"spectra is \(30, 3\)"):
        estimate_error_map(observation, restored, SPECTRA[:, 1:])
    with pytest.raises(ValueError, match="labels has 1 names"):
        estimate_error_map(observation, restored, SPECTRA, labels=["one"])
    with pytest.raises(ValueError, match="no light"):
        estimate_error_map(
            observation, replace(restored, image=np.zeros_like(restored.image)), SPECTRA
        )
    broken = restored.image.copy()
    broken[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="restored"):
        estimate_error_map(observation, replace(restored, image=broken), SPECTRA)
