"""Arguments and results of restorations: kinds of arrays, and clear errors for what can't be."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.signal import fftconvolve
from test_plug_and_play import chambolle

from optics.inverse import build_observation, restore
from optics.inverse.choice import METHODS
from optics.inverse.noise import squared_frequencies
from optics.inverse.restored_image import remaining_change
from optics.inverse.wiener import wiener

PSF = np.full((5, 5), 1 / 25)


@pytest.fixture(scope="module")
def frame():
    rng = np.random.default_rng(4)
    scene = np.kron(rng.random((12, 12)), np.ones((6, 6)))
    blurred = fftconvolve(scene, PSF, mode="valid")
    return blurred + rng.normal(0, 0.01, blurred.shape)


@pytest.mark.parametrize("method", METHODS)
def test_an_array_comes_back_as_the_kind_that_was_given(frame, method):
    given = restore(build_observation(frame, PSF), method=method, denoise=chambolle)
    assert isinstance(given.image, np.ndarray)
    assert given.image.shape == frame.shape
    tensor = restore(
        build_observation(torch.from_numpy(frame), PSF), method=method, denoise=chambolle
    )
    assert isinstance(tensor.image, torch.Tensor)
    assert np.array_equal(tensor.image.numpy(), given.image)


@pytest.mark.parametrize("kind", [np.float16, np.uint8, np.uint16, np.int32, np.float32])
def test_numbers_of_any_kind_are_restored(frame, kind):
    scale = 1 if np.issubdtype(kind, np.floating) else 200
    levels = np.rint(frame * scale) if scale > 1 else frame
    found = restore(build_observation(levels.clip(0).astype(kind), PSF)).image
    assert found.dtype == np.float32
    exact = restore(build_observation(frame, PSF)).image
    assert np.sqrt(np.mean((found / scale - exact) ** 2)) < 0.03


@pytest.mark.parametrize("name", ["image", "psf", "weights", "clipped"])
def test_what_is_no_array_of_numbers_is_named(frame, name):
    given = {"image": frame, "psf": PSF}
    with pytest.raises(TypeError, match=f"{name} is a list; give a torch tensor or a numpy array"):
        build_observation(**given | {name: frame.tolist()})
    with pytest.raises(TypeError, match=f"{name} is of torch.complex128; give real numbers"):
        build_observation(**given | {name: frame * 1j})
    with pytest.raises(TypeError, match="give an array of numbers"):
        build_observation(**given | {name: np.array([["a"]])})


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (3, 4)])
@pytest.mark.parametrize("border", ["unknown", "dark", "periodic"])
def test_the_smallest_frames_end_finite(shape, border):
    image = np.random.default_rng(2).random(shape)
    for method in METHODS:
        seen = build_observation(image, np.ones((1, 1)), 0.01, border)
        found = restore(seen, method=method, count=3, denoise=chambolle)
        assert np.isfinite(found.image).all()
        assert found.image.shape == shape


def test_what_can_not_be_restored_is_refused_with_a_remedy(frame):
    for image, psf, words in (
        (np.zeros((0, 5)), PSF, r"image is \(0, 5\) and psf \(5, 5\); both need at least one"),
        (frame, np.zeros((3, 0)), r"psf \(3, 0\); both need at least one pixel"),
        (frame, 29 * PSF, "psf sums to 29; .*divide the PSF by its sum"),
        (frame, -PSF, "psf sums to -1; it must send light somewhere"),
    ):
        with pytest.raises(ValueError, match=words):
            build_observation(image, psf)
    with pytest.raises(ValueError, match=r"noise is 1e\+06, and the photograph's largest pixel"):
        build_observation(frame, PSF, 1e6)
    with pytest.raises(TypeError, match="noise is 'low'"):
        build_observation(frame, PSF, "low")


def test_noise_that_is_told_as_nothing_ends_without_convergence(frame):
    """Then nothing is noise, and no picture of few edges leaves nothing."""
    told = restore(build_observation(frame, PSF, 0.0))
    assert told.residual > 10
    assert np.isfinite(told.image).all()


def test_iterations_that_are_too_few_havent_converged(frame):
    seen = build_observation(frame, PSF, 0.01)
    for method in ("total-variation", "poisson-tv", "wiener", "richardson-lucy"):
        assert not restore(seen, method=method, count=2).converged
    assert restore(seen, method="total-variation", count=200).converged
    assert restore(seen, method="richardson-lucy", count=200).converged
    assert restore(seen, method="wiener", count=200).converged


@pytest.mark.parametrize(
    ("changes", "left"),
    [([], np.inf), ([0.1], np.inf), ([0.1, 0.2], np.inf), ([0.1, 0.0], 0.0), ([0.4, 0.2], 0.2)],
)
def test_the_remaining_change_is_that_of_a_geometric_series(changes, left):
    assert remaining_change(changes) == pytest.approx(left)
    long = [0.3 * 0.8**n for n in range(30)]
    assert remaining_change(long) == pytest.approx(0.3 * 0.8**30 / (1 - 0.8))


@pytest.mark.parametrize("border", ["unknown", "dark", "periodic"])
def test_wieners_derivatives_are_those_of_a_dense_solution(border):
    """By photograph and PSF, against the solution of the whole linear system by autograd."""
    generator = torch.Generator().manual_seed(0)
    psf = 0.1 + torch.rand(5, 4, generator=generator, dtype=torch.float64)
    image = torch.rand(12, 11, generator=generator, dtype=torch.float64)
    psf /= 1.1 * psf.sum()
    weight, pull = 0.05, torch.linspace(-1, 2, 11, dtype=torch.float64)

    def objective(picture):
        return (picture.square() * pull).sum()

    def dense(image, psf):
        seen = build_observation(image, psf, 0.01, border)
        shape = seen.period_shape
        points = torch.eye(shape[0] * shape[1], dtype=torch.float64).reshape(-1, *shape)
        light = torch.fft.irfft2(torch.fft.rfft2(points) * seen.otf, s=shape)
        blur = seen.crop_to_frame(light).flatten(1).T
        penalty = weight * squared_frequencies(shape)
        prior = torch.fft.irfft2(torch.fft.rfft2(points) * penalty, s=shape).flatten(1).T
        data = image / psf.sum()
        detail = (data - data.mean()).flatten()
        found = torch.linalg.lstsq(blur.T @ blur + prior, blur.T @ detail[:, None]).solution
        return seen.crop_to_frame(found.reshape(shape)) + data.mean()

    def ours(image, psf):
        return wiener(build_observation(image, psf, 0.01, border), weight, steps=200).image

    derivatives = []
    for solve in (dense, ours):
        given = image.clone().requires_grad_(), psf.clone().requires_grad_()
        derivatives.append(torch.autograd.grad(objective(solve(*given)), given))
    for expected, found in zip(*derivatives, strict=True):
        assert float((found - expected).norm() / expected.norm()) < 1e-3
