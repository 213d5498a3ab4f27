"""Separable restoration against dense least squares, the two-dimensional solver, and scipy."""

import math

import numpy as np
import pytest
import torch
from judges import natural_image, relative
from scipy.ndimage import convolve1d
from scipy.signal import convolve2d
from skimage import data

from optics.inverse.observation_builder import build_observation
from optics.inverse.separable import (
    SeparableFilter,
    blur_matrix,
    restore_separable,
    separable_parts,
)
from optics.inverse.wiener import wiener

PRIORS = ["flat", "neighbours"]


def cubic_kernel(n: int, strength: float = 20.0, defocus: float = 4.0) -> np.ndarray:
    """Of a slit with a cubic phase, by a direct sum, on pixels of half a period of its cut-off."""
    x, u = np.linspace(-1, 1, 801), (np.arange(4 * n) - 2 * n) / 4
    field = np.exp(-1j * np.pi * np.outer(u, x)) @ np.exp(1j * (strength * x**3 + defocus * x**2))
    kernel = (np.abs(field) ** 2).reshape(n, 4).sum(1)
    return kernel / kernel.sum()


def blurred(shape, down, along, noise=0.01, seed=0):
    """The part of a photograph that all of the light of which is known, before and after."""
    rows, columns = (n + len(k) - 1 for n, k in zip(shape, (down, along), strict=True))
    scene = data.camera()[120 : 120 + rows, 140 : 140 + columns] / 255.0
    frame = convolve2d(scene, np.outer(down, along), mode="valid")
    top, left = (len(k) - 1 - len(k) // 2 for k in (down, along))
    truth = scene[top : top + shape[0], left : left + shape[1]]
    return truth, frame + np.random.default_rng(seed).normal(0, noise, shape)


def psnr(image, truth) -> float:
    return -10 * math.log10(np.mean((np.asarray(image) - truth) ** 2))


def written_out(down, along, shape, border):
    """The blur of a whole picture as one matrix, pixel by pixel, (frame, scene), and where the
    frame lies in the scene."""
    before = [len(k) - 1 - len(k) // 2 if border == "unknown" else 0 for k in (down, along)]
    more = [len(k) - 1 if border == "unknown" else 0 for k in (down, along)]
    rows, columns = (n + m for n, m in zip(shape, more, strict=True))
    matrix = np.zeros((shape[0] * shape[1], rows * columns))
    for y in range(shape[0]):
        for x in range(shape[1]):
            for j, a in enumerate(down):
                for i, b in enumerate(along):
                    v = y + before[0] - (j - len(down) // 2)
                    u = x + before[1] - (i - len(along) // 2)
                    if border == "periodic":
                        v, u = v % rows, u % columns
                    if 0 <= v < rows and 0 <= u < columns:
                        matrix[y * shape[1] + x, v * columns + u] += a * b
    return matrix, (rows, columns), before


def covariance(shape, border):
    """Of neighbours that correlate by 0.95 a pixel along each axis, written out."""
    each = []
    for n in shape:
        lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        if border == "periodic":
            # A period's correlation is the sum of all that lie whole periods apart.
            each.append(sum(0.95 ** np.abs(lag + k * n) for k in range(-100, 101)))
        else:
            each.append(0.95**lag)
    return np.kron(*each)


@pytest.mark.parametrize("border", ["unknown", "dark", "periodic"])
@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("sizes", [(5, 4), (4, 7), (1, 3)])
def test_it_is_the_dense_least_squares_solution(border, prior, sizes):
    """x = C A^T (A C A^T + weight)^-1 y with every matrix written out."""
    rng, shape, weight = np.random.default_rng(1), (9, 12), 0.02
    down, along = (rng.random(n) + 0.1 for n in sizes)
    image = rng.normal(size=shape)
    matrix, whole, before = written_out(down, along, shape, border)
    prior_covariance = np.eye(matrix.shape[1]) if prior == "flat" else covariance(whole, border)
    towards = prior_covariance @ matrix.T
    solution = towards @ np.linalg.solve(
        matrix @ towards + weight * np.eye(len(matrix)), image.ravel()
    )
    top, left = before
    truth = solution.reshape(whole)[top : top + shape[0], left : left + shape[1]]
    planned = SeparableFilter(down, along, shape, border, prior, dtype=torch.float64)
    assert relative(planned(image, weight), truth) <= 1e-9


@pytest.mark.parametrize("n", [1, 4, 5, 14])
@pytest.mark.parametrize(("border", "mode"), [("dark", "constant"), ("periodic", "wrap")])
def test_a_blur_matrix_blurs_as_scipy_does(n, border, mode):
    rng = np.random.default_rng(n)
    kernel, scene = rng.random(n), rng.random(15)
    expected = convolve1d(scene, kernel, mode=mode)
    assert relative(blur_matrix(kernel, 15, border) @ scene, expected) <= 1e-12


def test_beyond_an_unknown_border_lies_all_that_light_comes_from():
    kernel, scene = np.random.default_rng(0).random(6), np.random.default_rng(1).random(20)
    seen = blur_matrix(kernel, 15, "unknown") @ scene
    assert relative(seen, np.convolve(scene, kernel, mode="valid")) <= 1e-12


@pytest.mark.parametrize("border", ["unknown", "periodic"])
@pytest.mark.parametrize("weight", [1e-3, 0.03])
def test_a_flat_prior_is_the_filter_in_two_dimensions(border, weight):
    """The same problem by conjugate gradients on frequencies, to the end."""
    down, along = cubic_kernel(15), cubic_kernel(12, 12.0, -3.0)
    _, frame = blurred((50, 43), down, along)
    seen = build_observation(frame, np.outer(down, along), 0.01, border)
    ours = restore_separable(seen, weight, "flat")
    theirs = wiener(seen, weight, "flat", steps=3000)
    assert relative(ours.image, theirs.image) <= 5e-4
    assert ours.residual == pytest.approx(theirs.residual, rel=1e-3)


def test_on_a_period_it_is_wieners_filter():
    """H* O / (|H|² + K) by numpy's FFT, both axes together and each by itself."""
    down, along, k = cubic_kernel(9), cubic_kernel(7, 8.0), 0.01
    image = natural_image(24, 21, 5) - 0.5
    y, x = (
        np.fft.fft(np.roll(np.pad(kernel, (0, n - len(kernel))), -(len(kernel) // 2)))
        for kernel, n in zip((down, along), image.shape, strict=True)
    )
    h = y[:, None] * x
    alone = [axis.conj() / (np.abs(axis) ** 2 + k) for axis in (y, x)]
    for gain, joint in ((h.conj() / (np.abs(h) ** 2 + k), True), (np.outer(*alone), False)):
        expected = np.fft.ifft2(np.fft.fft2(image) * gain).real
        planned = SeparableFilter(
            down, along, image.shape, "periodic", joint=joint, dtype=torch.float64
        )
        assert relative(planned(image, k), expected) <= 1e-10


def test_filters_of_single_axes_are_the_least_of_their_own_problem():
    """|A X B^T - Y|² + k |A X|² + k |X B^T|² + k² |X|²: its gradient is 0 there."""
    down, along, k = cubic_kernel(7), cubic_kernel(5, 6.0), 0.05
    image = torch.from_numpy(natural_image(16, 13, 7) - 0.5)
    planned = SeparableFilter(down, along, (16, 13), "dark", joint=False, dtype=torch.float64)
    a, b = (torch.from_numpy(blur_matrix(h, n, "dark")) for h, n in ((down, 16), (along, 13)))
    x = planned(image, k).requires_grad_()
    cost = (a @ x @ b.T - image).square().sum() + k * (a @ x).square().sum()
    cost = cost + k * (x @ b.T).square().sum() + k**2 * x.square().sum()
    (slope,) = torch.autograd.grad(cost, x)
    assert float(slope.abs().max()) <= 1e-12


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_its_own_weight_is_near_the_best_there_is(prior, noise):
    """Judged by the true error over all weights of a grid."""
    down, along = cubic_kernel(21), cubic_kernel(21)
    truth, frame = blurred((96, 90), down, along, noise)
    seen = build_observation(frame, np.outer(down, along), None)
    best = max(
        psnr(restore_separable(seen, w, prior).image, truth)
        for w in np.logspace(-6, 1, 29).tolist()
    )
    assert psnr(restore_separable(seen, None, prior).image, truth) > best - 0.5


def test_neighbours_restore_better_than_a_flat_prior_and_both_better_than_nothing():
    down, along = cubic_kernel(21), cubic_kernel(21)
    truth, frame = blurred((96, 90), down, along)
    seen = build_observation(frame, np.outer(down, along), None)
    flat, neighbours = (psnr(restore_separable(seen, None, prior).image, truth) for prior in PRIORS)
    assert neighbours > flat + 0.5
    assert flat > psnr(frame, truth) + 3
    assert neighbours > psnr(wiener(seen).image, truth) - 1


def test_parts_make_the_psf_again():
    down, along = cubic_kernel(11), 0.3 * cubic_kernel(8)
    found = separable_parts(np.outer(down, along))
    assert found[0].sum() == pytest.approx(1)
    assert relative(found[0], down) <= 1e-12
    assert relative(found[1], along) <= 1e-12


def test_a_psf_that_is_no_product_is_refused_with_how_far_it_is_from_one():
    r = np.hypot(*np.mgrid[-4:5, -4:5])
    disk = (r <= 3.5) / (r <= 3.5).sum()
    values = np.linalg.svd(disk, compute_uv=False)
    left_out = math.sqrt(1 - values[0] ** 2 / (values**2).sum())
    with pytest.raises(ValueError, match=rf"isn't separable.*leaves out {left_out:.2g} of it"):
        separable_parts(disk)
    with pytest.raises(ValueError, match="isn't separable"):
        restore_separable(build_observation(np.ones((20, 20)), disk))
    assert separable_parts(disk, 1.1 * left_out)[0].shape == (9,)


def test_a_filter_passes_gradients_and_takes_stacks():
    planned = SeparableFilter(cubic_kernel(5), cubic_kernel(5), (8, 9), dtype=torch.float64)
    frames = torch.rand(3, 8, 9, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda f: planned(f, 0.1), frames)
    each = torch.stack([planned(one, 0.1) for one in frames])
    assert torch.allclose(planned(frames, 0.1), each)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_precision_is_the_images_and_single_is_enough(dtype):
    down, along = cubic_kernel(15), cubic_kernel(15)
    _, frame = blurred((40, 40), down, along)
    psf = np.outer(down, along)
    restored = restore_separable(build_observation(frame.astype(dtype), psf, 0.01), 1e-3).image
    exact = restore_separable(build_observation(frame, psf, 0.01), 1e-3).image
    assert restored.numpy().dtype == dtype
    assert relative(restored, exact) <= 1e-5


def test_a_constant_picture_stays_constant():
    psf = 0.5 * np.outer(cubic_kernel(9), cubic_kernel(9))
    assert np.allclose(restore_separable(build_observation(np.full((20, 22), 3.0), psf)).image, 6.0)


def test_multiplications_are_those_of_the_products():
    planned = SeparableFilter(cubic_kernel(5), cubic_kernel(5), (8, 9))
    assert planned.multiplications == 2 * (8 * 8 * 9) + 2 * (8 * 9 * 9) + 8 * 9


def test_bad_arguments_are_refused_by_name():
    kernel, frame = cubic_kernel(5), np.ones((12, 12))
    with pytest.raises(ValueError, match=r"prior is 'edges'; take one of neighbours, flat"):
        SeparableFilter(kernel, kernel, (8, 8), prior="edges")
    with pytest.raises(ValueError, match=r"border is 'mirrored'"):
        SeparableFilter(kernel, kernel, (8, 8), "mirrored")
    with pytest.raises(ValueError, match=r"along is \(5, 5\); a kernel has one axis"):
        SeparableFilter(kernel, np.outer(kernel, kernel), (8, 8))
    with pytest.raises(ValueError, match=r"image is \(12, 12\); its last axes must be \(8, 8\)"):
        SeparableFilter(kernel, kernel, (8, 8))(frame, 0.1)
    with pytest.raises(ValueError, match="weight is -1; it must be positive"):
        restore_separable(build_observation(frame, np.outer(kernel, kernel)), -1.0)
    with pytest.raises(ValueError, match="don't separate into rows and columns"):
        restore_separable(
            build_observation(frame, np.outer(kernel, kernel), clipped=frame > np.eye(12))
        )
