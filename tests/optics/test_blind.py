"""Blind deconvolution: its steps against dense linear algebra, whole runs against known kernels."""

import math

import numpy as np
import pytest
import scipy.ndimage
import scipy.optimize
import scipy.signal
import torch
from skimage import data

from optics.inverse import build_observation, restore
from optics.inverse.blind import (
    LatentImageSampler,
    estimate_photograph_noise,
    find_kernel,
    kernel_deviation,
)
from optics.inverse.gradient_statistics import GaussianMixture
from optics.inverse.kernel_search import (
    NormalisedPhotograph,
    align_kernel,
    centre_kernel,
    downsample,
    enlarge_kernel,
    fast_period,
    least_squares_problem,
    minimise_nonnegative,
    next_odd,
    padded_spectrum,
    project_onto_simplex,
    without_specks,
)
from optics.progress import Cancelled, Progress

SIZE = 9


def stroke() -> np.ndarray:
    """Bent, without symmetry, of 7 x 7."""
    kernel = np.zeros((7, 7))
    for y, x, light in ((1, 1, 2), (2, 1, 2), (3, 2, 3), (4, 3, 3), (4, 4, 2), (5, 5, 1)):
        kernel[y, x] = light
    return kernel / kernel.sum()


def photograph(kernel: np.ndarray, seed: int = 0, noise: float = 0.005, side: int = 112):
    scene = data.camera()[60 : 60 + side, 170 : 170 + side] / 255.0
    seen = scipy.signal.convolve2d(scene, kernel, mode="valid")
    seen += np.random.default_rng(seed).normal(0, noise, seen.shape)
    m = kernel.shape[0]
    inside = slice((m - 1) // 2, (m - 1) // 2 + seen.shape[0])
    return seen, scene[inside, inside]


def fitted(found: np.ndarray, truth: np.ndarray) -> tuple[float, np.ndarray]:
    """Relative error, and the truth moved to where the found kernel is, by parts of a pixel."""
    padded = np.zeros_like(found)
    start = found.shape[0] // 2 - truth.shape[0] // 2
    padded[start : start + truth.shape[0], start : start + truth.shape[1]] = truth

    def moved(shift):
        return scipy.ndimage.shift(padded, shift, order=1)

    places = [(a, b) for a in np.arange(-3, 3.1, 0.25) for b in np.arange(-3, 3.1, 0.25)]
    best = min(places, key=lambda shift: np.linalg.norm(moved(shift) - found))
    return np.linalg.norm(moved(best) - found) / np.linalg.norm(truth), moved(best)


def dense(known: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Columns: the full convolution of known gradients with each pixel of a kernel."""
    columns = []
    for number in range(shape[0] * shape[1]):
        one = np.zeros(shape[0] * shape[1])
        one[number] = 1
        columns.append(scipy.signal.convolve2d(known, one.reshape(shape)).ravel())
    return np.array(columns).T


def test_the_kernel_step_is_least_squares_with_bounds():
    rng = np.random.default_rng(0)
    known, shape = rng.normal(size=(14, 11)), (4, 3)
    matrix = dense(known, shape)
    measured = matrix @ rng.normal(0.1, 0.3, 12) + 0.1 * rng.normal(size=matrix.shape[0])
    period = fast_period(17, 13)
    spectra = (
        padded_spectrum(torch.from_numpy(one)[None], period)
        for one in (known, measured.reshape(17, 13))
    )
    problem = least_squares_problem(*spectra, shape)
    assert problem.normal_matrix.numpy() == pytest.approx(matrix.T @ matrix, abs=1e-9)
    assert problem.right_hand_side.numpy().ravel() == pytest.approx(matrix.T @ measured, abs=1e-9)
    start = torch.full(shape, 1 / 12, dtype=torch.float64)
    found = minimise_nonnegative(problem, start, sum_is_one=False, steps=2000)
    expected, _ = scipy.optimize.nnls(matrix, measured)
    assert found.numpy().ravel() == pytest.approx(expected, abs=1e-4)
    ridged = (
        minimise_nonnegative(problem.with_ridge(50.0), start, sum_is_one=True, steps=2000)
        .numpy()
        .ravel()
    )
    assert ridged.sum() == pytest.approx(1)
    slope = matrix.T @ (matrix @ ridged - measured) + 50 * ridged
    # Optimal: of what is positive all slopes are alike, of the rest none is below.
    level = slope[ridged > 1e-6].mean()
    assert slope[ridged > 1e-6] == pytest.approx(level, abs=2e-2)
    assert slope.min() > level - 2e-2


def test_the_nearest_point_of_a_simplex():
    assert project_onto_simplex(torch.tensor([0.5, 0.5, -1.0])).tolist() == pytest.approx(
        [0.5, 0.5, 0]
    )
    assert project_onto_simplex(torch.tensor([3.0, 0.0])).tolist() == pytest.approx([1, 0])


def test_pictures_are_drawn_from_the_posterior_of_dense_algebra():
    """For gradients of known precisions it is a normal one, nothing assumed of the border."""
    rng = np.random.default_rng(1)
    kernel = rng.uniform(size=(3, 3))
    kernel /= kernel.sum()
    seen, noise, field = rng.normal(size=(6, 5)), 0.3, (8, 7)
    seen -= seen.mean()
    known = (rng.uniform(size=(6, 5)) > 0.2).astype(float)
    along, down = rng.uniform(0.5, 5, (8, 6)), rng.uniform(0.5, 5, (7, 7))
    units = np.eye(56).reshape(-1, *field)
    blur = np.array([scipy.signal.convolve2d(one, kernel, mode="valid").ravel() for one in units]).T
    steps = [np.array([np.diff(one, axis=axis).ravel() for one in units]).T for axis in (1, 0)]
    precision = blur.T @ (known.ravel()[:, None] * blur) / noise**2
    for step, weights in zip(steps, (along, down), strict=True):
        precision += step.T @ (weights.ravel()[:, None] * step)
    mean = np.linalg.solve(precision, blur.T @ (known * seen).ravel() / noise**2)
    covariance = np.linalg.inv(precision)

    latent = LatentImageSampler(
        torch.from_numpy(seen),
        torch.from_numpy(known),
        GaussianMixture((1.0,), (1.0,)),
        (3, 3),
        seed=0,
    )
    told = [torch.from_numpy(one) for one in (kernel, along, down)]
    count = 300
    drawn = np.array(
        [latent.sample_picture(told[0], noise, *told[1:]).numpy().ravel() for _ in range(count)]
    )
    spread = np.sqrt(np.diag(covariance))
    assert np.abs((drawn.mean(0) - mean) / spread).max() < 4.5 / math.sqrt(count)
    wrong = (np.cov(drawn.T) - covariance) / np.outer(spread, spread)
    assert np.abs(wrong).max() < 6 / math.sqrt(count)


def test_components_are_drawn_as_often_as_they_are_likely():
    mixture = GaussianMixture((0.7, 0.3), (0.02, 0.15))
    image = torch.zeros(8, 8, dtype=torch.float64)
    latent = LatentImageSampler(image, torch.ones_like(image), mixture, (3, 3), seed=0)
    length = 0.05
    drawn = latent._sample_precisions(torch.full((300, 300), length, dtype=torch.float64))
    likely = [
        share / deviation * math.exp(-((length / deviation) ** 2) / 2)
        for share, deviation in zip(mixture.shares, mixture.deviations, strict=True)
    ]
    share = float((drawn > 1 / 0.1**2).double().mean())
    assert share == pytest.approx(likely[0] / sum(likely), abs=0.01)


def test_kernels_are_moved_to_where_they_are_alike():
    y, x = np.mgrid[:15, :15] - 7.0
    bump = torch.from_numpy(np.exp(-(y**2 + 2 * x**2) / 8))
    moved = torch.from_numpy(np.exp(-((y - 1.25) ** 2 + 2 * (x + 0.75) ** 2) / 8))
    assert align_kernel(moved, bump).numpy() == pytest.approx(bump.numpy(), abs=0.02)


def test_a_search_that_ends_elsewhere_is_not_trusted():
    """Though all parts go on from the same kernel and stay there."""
    photo = NormalisedPhotograph(torch.zeros(40, 40), torch.ones(40, 40), 0.01)
    kernel, other = torch.zeros(9, 9), torch.zeros(9, 9)
    kernel[4, 2:7], other[2:7, 4] = 0.2, 0.2

    def stays(part, start, progress):
        return start

    same = kernel_deviation(photo, kernel, kernel, stays, Progress())
    apart = kernel_deviation(photo, kernel, other, stays, Progress())
    assert float(same.square().sum()) < 1e-6
    assert float(apart.square().sum()) > float(kernel.square().sum())


def test_kernels_are_enlarged_about_their_origin_and_centred():
    point = torch.zeros(5, 5)
    point[2, 2] = 1
    larger = enlarge_kernel(point, math.sqrt(2), 7)
    assert float(larger.sum()) == pytest.approx(1)
    assert torch.equal(larger, larger.flip(0, 1))
    corner = torch.zeros(9, 9)
    corner[0, 8] = 1
    assert float(centre_kernel(corner, 5)[2, 2]) == 1
    assert [next_odd(n) for n in (1, 3, 3.2, 8, 9)] == [3, 3, 5, 9, 9]


def test_shrinking_keeps_the_mean():
    image = torch.from_numpy(data.camera()[:64, :64] / 255.0)
    assert float(downsample(image, 2.0).mean()) == pytest.approx(float(image.mean()), rel=1e-2)


def test_specks_go_and_strokes_stay():
    kernel = torch.zeros(9, 9)
    kernel[2:7, 4], kernel[0, 0] = 1.0, 0.1
    clean = without_specks(kernel, 0.0, 0.1)
    assert float(clean[0, 0]) == 0
    assert clean[2:7, 4].tolist() == pytest.approx([0.2] * 5)


@pytest.mark.parametrize("noise", [0.003, 0.02])
def test_noise_is_told_by_the_finest_detail(noise):
    seen, _ = photograph(np.full((7, 7), 1 / 49), noise=noise)
    seen = torch.from_numpy(seen)
    assert estimate_photograph_noise(seen, torch.ones_like(seen)) == pytest.approx(noise, rel=0.25)


@pytest.fixture(scope="module")
def runs():
    """The same scene and blur with two noises."""
    return [find_kernel(photograph(stroke(), seed)[0], SIZE) for seed in range(2)]


def test_a_known_kernel_is_found(runs):
    for run in runs:
        assert run.psf.shape == (SIZE, SIZE)
        assert run.psf.min() >= 0
        assert run.psf.sum() == pytest.approx(1)
        assert fitted(run.psf, stroke())[0] < 0.5


def test_its_deviation_is_honest(runs):
    """Over seeds, the error is what it was told to be, within a factor."""
    wrong = [np.sum((run.psf - fitted(run.psf, stroke())[1]) ** 2) for run in runs]
    told = [np.sum(run.deviation**2) for run in runs]
    assert 0.4 < math.sqrt(np.mean(wrong) / np.mean(told)) < 2.5


def test_the_picture_gets_better():
    seen, truth = photograph(stroke(), side=150)
    found = restore(build_observation(seen, find_kernel(seen, SIZE).psf))
    inside = slice(12, -12)

    def wrong(picture):
        moves = [(a, b) for a in np.arange(-2, 2.1, 0.5) for b in np.arange(-2, 2.1, 0.5)]
        shifted = (scipy.ndimage.shift(picture, one, order=3, mode="nearest") for one in moves)
        return min(np.mean((one - truth)[inside, inside] ** 2) for one in shifted)

    assert wrong(np.asarray(found.image)) < 0.8 * wrong(seen)


def test_light_may_have_any_scale_and_pixels_be_clipped():
    seen, _ = photograph(stroke())
    top = float(np.quantile(seen, 0.97))
    full = seen >= top
    burnt = np.where(full, top, seen)
    run = find_kernel(4000 * burnt, SIZE, noise=4000 * 0.005, clipped=full)
    assert run.noise == pytest.approx(20)
    assert fitted(run.psf, stroke())[0] < 0.6


@pytest.mark.sweep
def test_the_same_photograph_gives_the_same_kernel(runs):
    again = find_kernel(photograph(stroke(), 0)[0], SIZE)
    assert np.array_equal(again.psf, runs[0].psf)


def test_noise_alone_is_not_trusted():
    noise = np.random.default_rng(0).normal(0.5, 0.1, (96, 96))
    with pytest.raises(ValueError, match="nothing that a blur could be told by"):
        find_kernel(noise, SIZE)


@pytest.mark.parametrize(
    ("image", "more", "words"),
    [
        (np.full((64, 64), 0.5), {}, "sharp edges"),
        (np.zeros((64, 64)), {}, "sharp edges"),
        (np.ones((64, 64, 3)), {}, "one band"),
        (np.full((64, 64), np.nan), {}, "NaN"),
        (np.eye(20), {}, "kernels wide"),
        (np.eye(64), {"noise": -1.0}, "noise"),
        (np.eye(64), {"clipped": np.ones((3, 3), bool)}, "clipped"),
        (np.eye(64), {"clipped": np.ones((64, 64), bool)}, "expose"),
    ],
)
def test_what_cannot_be_used_is_refused(image, more, words):
    with pytest.raises(ValueError, match=words):
        find_kernel(image, SIZE, **more)


def test_a_size_must_be_a_whole_number():
    with pytest.raises(ValueError, match="size is 2"):
        find_kernel(np.eye(64), 2)


def test_it_tells_how_far_it_is_and_stops_when_asked():
    heard = []

    def listen(fraction, words):
        heard.append(fraction)
        if len(heard) > 3:
            progress.cancel()

    progress = Progress(listen)
    with pytest.raises(Cancelled):
        find_kernel(photograph(stroke())[0], SIZE, progress=progress)
    assert heard == sorted(heard)
