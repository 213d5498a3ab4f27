"""Spectral bands of one photograph, and the covariance that a scene's own spectra have."""

import numpy as np
import pytest
import torch
from scipy.signal import fftconvolve
from scipy.sparse.linalg import LinearOperator, cg

from optics.inverse import build_mosaic_observation
from optics.metrics import psnr, spectral_angle
from optics.multispectral import restore_spectra
from optics.multispectral.restoration import _GradientErrors, adapt_covariance
from optics.progress import Cancelled, Progress

BAYER = ("RG", "GB")
LETTERS = np.array([[0, 1], [1, 2]])
RESPONSE = np.array([[0.05, 0.1, 0.7, 0.9], [0.2, 0.7, 0.3, 0.06], [0.75, 0.2, 0.02, 0.04]])
"""Of red, green and blue filters; the last two bands are nearly alike in red."""


def rings(radii, reach=9):
    at = np.arange(-reach, reach + 1)
    far = np.hypot(at[:, None], at)
    shapes = np.exp(-(((far - np.asarray(radii)[:, None, None]) / 0.6) ** 2) / 2)
    shapes = 0.8 * shapes / shapes.sum((1, 2), keepdims=True)
    shapes[:, reach, reach] += 0.2
    return shapes


PSFS = rings([3, 5, 7, 9])


def typical(count=60, seed=0):
    """Smooth spectra, from dark to bright."""
    rng = np.random.default_rng(seed)
    slopes = np.array([[1, 1, 1, 1], [-1, -0.3, 0.3, 1], [-1, 1, 1, -1], [-0.3, 1, -1, 0.3]])
    shares = rng.normal(size=(count, 4)) * [0.0, 0.35, 0.2, 0.15] + [1.0, 0, 0, 0]
    return (rng.uniform(0.2, 1, (count, 1)) * (shares @ slopes)).clip(0.02, None)


def patches(spectra, side=96, size=16, seed=1):
    """Squares of a few spectra."""
    places = np.random.default_rng(seed).integers(len(spectra), size=(side // size,) * 2)
    return np.moveaxis(np.kron(spectra[places], np.ones((size, size, 1))), -1, 0)


def photograph(scene, noise=0.0, seed=0, psfs=PSFS, response=RESPONSE):
    raw = np.zeros(scene.shape[1:])
    for band, psf, shares in zip(scene, psfs, response.T, strict=True):
        blurred = fftconvolve(band, psf, mode="same")
        for y, x in np.ndindex(2, 2):
            raw[y::2, x::2] += shares[LETTERS[y, x]] * blurred[y::2, x::2]
    return raw + np.random.default_rng(seed).normal(0, noise, raw.shape)


def observe(raw, **told):
    return build_mosaic_observation(
        raw.astype(np.float32), BAYER, PSFS, response=RESPONSE, border="dark", **told
    )


@pytest.fixture(scope="module")
def unusual_scene():
    """Patches of spectra that few typical spectra are like."""
    return patches(np.array([[0.5, 0.2, 0.7, 0.4], [0.2, 0.5, 0.2, 0.5], [0.3, 0.4, 0.1, 0.3]]))


@pytest.fixture(scope="module")
def restorations(unusual_scene):
    seen = observe(photograph(unusual_scene, 0.005))
    return [restore_spectra(seen, typical(), iterations=60, adapts=one) for one in (False, True)]


def test_bands_that_filters_see_alike_are_told_apart_by_their_psfs(unusual_scene):
    alike = RESPONSE.copy()
    alike[:, 3] = alike[:, 2]
    levels = []
    for psfs in (PSFS, PSFS[:1]):
        stack = np.broadcast_to(psfs, (4, *psfs.shape[1:]))
        raw = photograph(unusual_scene, 0.002, psfs=stack, response=alike)
        seen = build_mosaic_observation(
            raw.astype(np.float32), BAYER, stack, response=alike, border="dark"
        )
        found = restore_spectra(seen, typical(), iterations=60).image
        levels.append([psnr(found[one], unusual_scene[one]) for one in (2, 3)])
    assert min(np.subtract(*levels)) > 1, levels


def test_a_scene_with_unusual_spectra_is_restored_better_by_its_own(unusual_scene, restorations):
    typical_one, own = (one.image for one in restorations)
    assert psnr(own, unusual_scene) > psnr(typical_one, unusual_scene) + 0.3
    assert spectral_angle(own, unusual_scene) < spectral_angle(typical_one, unusual_scene)


def test_arrays_give_arrays_and_no_light_is_negative(restorations):
    for found in restorations:
        assert isinstance(found.image, np.ndarray)
        assert np.isfinite(found.image).all()
        assert found.image.min() >= 0


def test_the_scenes_covariance_is_that_of_means_and_errors():
    """The covariance of Gaussian scenes is that of their posterior means plus the posterior one.

    The means are computed pixel by pixel, with conjugate gradients.
    """
    side, noise, slope = 128, 0.02, 2.2
    root = np.array([[1, 0, 0, 0], [0.6, 0.5, 0, 0], [0.3, 0.5, 0.5, 0], [0.1, -0.3, 0.2, 0.4]])
    covariance = root @ root.T
    along = np.fft.fftfreq(side)
    squares = along[:, None] ** 2 + along**2
    gradient = 4 * (np.sin(np.pi * along)[:, None] ** 2 + np.sin(np.pi * along) ** 2)
    power = (squares + 1 / side**2) ** (-slope / 2)
    power /= (power * gradient).mean()
    rng = np.random.default_rng(0)
    white = np.fft.fft2(rng.normal(size=(4, side, side)))
    scene = np.fft.ifft2(np.einsum("kn,nyx->kyx", root, white * np.sqrt(power))).real
    wide = np.zeros((4, side, side))
    wide[:, :19, :19] = PSFS
    transfer = np.fft.fft2(np.roll(wide, (-9, -9), (1, 2)))
    tiles = (1, side // 2, side // 2)
    filters = np.tile(RESPONSE.T[:, LETTERS], tiles)

    def forward(x):
        return (filters * np.fft.ifft2(np.fft.fft2(x) * transfer).real).sum(0)

    def prior_of_adjoint(y):
        back = np.fft.fft2(filters * y) * transfer.conj() * power
        return np.fft.ifft2(np.einsum("kn,nyx->kyx", covariance, back)).real

    raw = forward(scene) + rng.normal(0, noise, (side, side))
    normal = LinearOperator(
        (side**2,) * 2,
        lambda u: (
            forward(prior_of_adjoint(u.reshape(side, side))) + noise**2 * u.reshape(side, side)
        ).ravel(),
    )
    weights, failed = cg(normal, raw.ravel(), rtol=1e-4, maxiter=3000)
    assert not failed
    mean = prior_of_adjoint(weights.reshape(side, side))
    steps = [np.roll(mean, -1, axis) - mean for axis in (1, 2)]
    moments = sum(np.einsum("kyx,lyx->kl", one, one) for one in steps) / side**2
    seen = build_mosaic_observation(
        raw, BAYER, PSFS, response=RESPONSE, noise=noise, border="periodic"
    )
    errors = _GradientErrors(seen).posterior_covariance(torch.from_numpy(covariance)).numpy()
    assert errors.trace() > 0.2 * covariance.trace()
    assert abs(moments + errors - covariance).max() < 0.03 * covariance.max()


def test_the_adapted_covariance_is_positive_and_of_the_scene(unusual_scene):
    seen = observe(photograph(unusual_scene, 0.005))
    spectra = torch.from_numpy(typical())
    start = spectra.mT @ spectra
    found = adapt_covariance(seen, torch.from_numpy(unusual_scene), start)
    assert float(found.trace()) == pytest.approx(1)
    assert float(torch.linalg.eigvalsh(found).min()) > 0
    steps = np.concatenate([np.diff(unusual_scene, axis=one).reshape(4, -1) for one in (1, 2)], 1)
    own = steps @ steps.T / np.trace(steps @ steps.T)
    away = [np.linalg.norm(one / np.trace(one) - own) for one in (found.numpy(), start.numpy())]
    assert away[0] < 0.2 * away[1]


def test_an_even_picture_keeps_the_typical_covariance():
    even = np.full((4, 32, 32), 0.5)
    spectra = torch.from_numpy(typical())
    start = spectra.mT @ spectra
    seen = build_mosaic_observation(np.ones((32, 32)), BAYER, PSFS, response=RESPONSE)
    found = adapt_covariance(seen, torch.from_numpy(even), start)
    torch.testing.assert_close(found, start / start.trace())
    restored = restore_spectra(observe(np.ones((32, 32))), typical(), iterations=3)
    assert np.isfinite(restored.image).all()


@pytest.mark.parametrize(
    ("spectra", "words"),
    [
        (typical()[:, :3], "spectra have 3 bands; the observation has 4"),
        (typical()[:3], "spectra are 3 of 4 bands; give 4 or more"),
        (np.zeros((9, 4)), "aren't all 0"),
        (np.full((9, 4), np.nan), "spectra"),
        (np.ones(4), "give \\(samples, bands\\)"),
    ],
)
def test_spectra_that_say_nothing_are_refused(spectra, words):
    seen = observe(np.ones((32, 32)))
    with pytest.raises(ValueError, match=words):
        restore_spectra(seen, spectra)


def test_a_bad_weight_or_number_is_refused():
    seen = observe(np.ones((32, 32)))
    with pytest.raises(ValueError, match="weight"):
        restore_spectra(seen, typical(), weight=-1.0)
    with pytest.raises(ValueError, match="iterations"):
        restore_spectra(seen, typical(), iterations=0)


def test_both_halves_report_and_can_be_cancelled():
    seen, fractions = observe(photograph(patches(typical()), 0.01)), list[float]()

    def note(fraction, message):
        fractions.append(fraction)

    restore_spectra(seen, typical(), iterations=4, progress=Progress(note))
    assert fractions == sorted(fractions)
    assert fractions[-1] > 0.8
    stopped = Progress()
    stopped.cancel()
    with pytest.raises(Cancelled):
        restore_spectra(seen, typical(), iterations=4, progress=stopped)
