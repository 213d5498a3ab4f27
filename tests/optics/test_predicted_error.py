"""Predicted errors against the dense solution of drawn scenes, blurred by scipy."""

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import convolve

from optics.multispectral import SceneSpectrum, predict_errors

SIDE = 16
RESPONSE = np.array([[0.8, 0.3, 0.1], [0.2, 0.7, 0.3], [0.1, 0.2, 0.9]])
SPECTRA = np.random.default_rng(1).random((20, 3))
SLOPE, CONTRAST = 2.5, 0.6
SCENE = SceneSpectrum(SLOPE, CONTRAST)
NOISE = 0.02
BAYER = ("RG", "GB")
PATTERNS = [BAYER, ("RGBG",), ("R", "B"), ("G",)]


def kernels(bands=3):
    psfs = np.random.default_rng(2).random((bands, 5, 3)) ** 4
    return psfs / psfs.sum((1, 2), keepdims=True)


def sensor(scene, psfs, pattern):
    """The raw picture of a scene that repeats; convolve's origin is n // 2 as well."""
    letters = np.array([["RGB".index(letter) for letter in row] for row in pattern])
    letters = np.tile(letters, (SIDE // letters.shape[0], SIDE // letters.shape[1]))
    blurred = [convolve(band, psf, mode="wrap") for band, psf in zip(scene, psfs, strict=True)]
    return sum(shares[letters] * band for shares, band in zip(RESPONSE.T, blurred, strict=True))


def scene_power(side):
    f = np.fft.fftfreq(side)
    far = np.hypot(f[:, None], f)
    far[0, 0] = np.inf
    return CONTRAST**2 * far**-SLOPE / np.mean(far**-SLOPE)


def dense(psfs, pattern):
    """The forward matrix, the scene's covariance, and the matrix of the best linear estimate."""
    size = SIDE * SIDE
    columns = []
    for n in range(3 * size):
        pulse = np.zeros(3 * size)
        pulse[n] = 1.0
        columns.append(sensor(pulse.reshape(3, SIDE, SIDE), psfs, pattern).ravel())
    forward = np.stack(columns, 1)
    correlation = np.fft.ifft2(scene_power(SIDE)).real
    at = np.arange(SIDE)
    apart = (at[:, None] - at) % SIDE
    places = correlation[apart[:, None, :, None], apart[None, :, None, :]].reshape(size, size)
    prior = np.kron(SPECTRA.T @ SPECTRA / len(SPECTRA), places)
    data = forward @ prior @ forward.T + NOISE**2 * np.eye(size)
    return forward, prior, np.linalg.solve(data, forward @ prior).T


def predicted(psfs, pattern=BAYER, noise=NOISE, **options):
    given = {"scene": SCENE, "noise_excess": 1.0, "period": SIDE, **options}
    return predict_errors(psfs, RESPONSE, pattern, SPECTRA, noise, **given)


def test_the_error_is_that_of_the_best_linear_estimate_of_drawn_scenes():
    """300 scenes of the prior, each seen and restored by dense matrices."""
    psfs, rng = kernels(), np.random.default_rng(3)
    _, prior, estimate = dense(psfs, BAYER)
    scenes = np.linalg.cholesky(prior + 1e-12 * np.eye(len(prior))) @ (
        rng.standard_normal((len(prior), 300))
    )
    raw = np.stack([sensor(one.reshape(3, SIDE, SIDE), psfs, BAYER).ravel() for one in scenes.T], 1)
    restored = estimate @ (raw + rng.normal(0, NOISE, raw.shape))
    measured = np.sqrt(np.mean((restored - scenes).reshape(3, -1) ** 2, axis=1))
    assert predicted(psfs).rms.numpy() == pytest.approx(measured, rel=0.02)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_error_is_that_of_the_dense_posterior(pattern):
    psfs = kernels()
    forward, prior, estimate = dense(psfs, pattern)
    left = np.diagonal(prior - estimate @ forward @ prior).reshape(3, -1).mean(1)
    found = predicted(psfs, pattern)
    assert found.rms.numpy() == pytest.approx(np.sqrt(left), rel=1e-6)
    point = np.ones((3, 1, 1))
    forward, prior, estimate = dense(point, pattern)
    sharp = np.diagonal(prior - estimate @ forward @ prior).reshape(3, -1).mean(1)
    assert found.filters_rms.numpy() == pytest.approx(np.sqrt(sharp), rel=1e-6)
    share = (sharp - found.rms.numpy() ** 2) / (CONTRAST**2 * np.mean(SPECTRA**2, 0))
    assert found.separated_share.numpy() == pytest.approx(share, rel=1e-6)


def test_without_light_nothing_is_known_and_with_more_noise_less():
    psfs = kernels()
    rms = CONTRAST * np.sqrt(np.mean(SPECTRA**2, 0))
    assert predicted(psfs, noise=1e4).rms.numpy() == pytest.approx(rms, rel=1e-4)
    levels = [predicted(psfs, noise=noise).mean_psnr for noise in (0.001, 0.01, 0.1)]
    assert levels[0] > levels[1] > levels[2]


def test_each_pixel_of_one_known_band_is_averaged_as_wiener_does():
    """A single band behind one filter: the error is that of Wiener's filter, a sum over f."""
    psf = kernels(1)
    found = predict_errors(
        psf, [[0.5]], ("R",), [[1.0]], 0.1, channels="R", scene=SCENE, noise_excess=1.0, period=32
    )
    power = scene_power(32)
    squares = np.abs(np.fft.fft2(np.pad(psf[0], ((0, 27), (0, 29))))) ** 2 / 4
    wiener = np.mean(power * 0.1**2 / (power * squares + 0.1**2))
    assert float(found.rms[0]) == pytest.approx(math.sqrt(wiener), rel=1e-9)


def test_behind_one_filter_psfs_move_error_from_band_to_band():
    """There is one datum for each frequency of two bands, whatever the PSFs are."""
    independent, grey = np.eye(2), np.ones((1, 2))
    alike, apart = np.zeros((2, 2, 9, 9))
    alike[:, 4, 4] = 1.0
    apart[0, 4, 4] = 1.0
    apart[1, 4, [0, 8]] = apart[1, [0, 8], 4] = 0.25
    same, other = (
        predict_errors(psfs, grey, ("R",), independent, 1e-5, channels="R", scene=SCENE)
        for psfs in (alike, apart)
    )
    assert same.separated_share.numpy() == pytest.approx([0, 0], abs=1e-9)
    # A sum of two equal, independent bands leaves half of each one's power unknown.
    assert same.rms.numpy() ** 2 == pytest.approx([CONTRAST**2 / 4] * 2, rel=1e-6)
    assert float(other.separated_share[0]) > 0.01
    assert float(other.separated_share.sum()) == pytest.approx(0, abs=1e-6)


def test_an_excess_of_noise_is_noise():
    more, excess = predicted(kernels(), noise=3 * NOISE), predicted(kernels(), noise_excess=3.0)
    assert excess.rms.numpy() == pytest.approx(more.rms.numpy(), rel=1e-12)


def test_tensors_and_levels_in_decibels():
    found = predicted(torch.from_numpy(kernels()))
    assert found.psnr.numpy() == pytest.approx(-20 * np.log10(found.rms.numpy()))
    assert found.mean_psnr == pytest.approx(float(np.mean(found.psnr.numpy())))


@pytest.mark.parametrize(
    ("argument", "value"),
    [("psfs", np.ones((3, 3))), ("psfs", np.ones((2, 3, 3))), ("psfs", np.full((3, 3, 3), np.nan)),
     ("response", np.ones(3)), ("spectra", np.ones((4, 2))), ("noise", 0.0), ("noise", math.inf),
     ("noise_excess", 0.0), ("period", 15), ("period", 0), ("pattern", ("RX", "GB"))],
)  # fmt: skip
def test_bad_arguments_are_named(argument, value):
    given = {"psfs": kernels(), "response": RESPONSE, "pattern": BAYER, "spectra": SPECTRA,
             "noise": NOISE, argument: value}  # fmt: skip
    with pytest.raises(ValueError, match=argument):
        predict_errors(**given)


@pytest.mark.parametrize(
    ("argument", "value"), [("slope", 0.0), ("contrast", 0.0), ("contrast", 1.1)]
)
def test_a_spectrum_of_scenes_falls_and_has_contrast(argument, value):
    with pytest.raises(ValueError, match=argument):
        SceneSpectrum(**{argument: value})
