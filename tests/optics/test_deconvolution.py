"""Blur made on a finer grid and a larger field than the solver's: no inverse crime."""

import itertools
import math

import numpy as np
import pytest
import torch
from judges import binned, gaussian_psf, natural_image, positions, relative
from scipy.signal import convolve2d, fftconvolve
from skimage import restoration

from optics.inverse.blur import blur_shape, transfer_function
from optics.inverse.observation import extend_periodically, require_psf
from optics.inverse.observation_builder import build_observation
from optics.inverse.richardson_lucy import richardson_lucy
from optics.inverse.wiener import wiener
from optics.progress import Cancelled, Progress

FINE, SIDE, MARGIN, RADIUS = 3, 72, 16, 4.0


def filtered(image, psf, weight=None, smooth="flat", noise=1e-3) -> np.ndarray:
    return wiener(build_observation(image, psf, noise), weight, smooth).image.numpy()


def likeliest(image, psf, iterations, **how) -> np.ndarray:
    """By the plain algorithm, to the end."""
    how = {"accelerate": False, "continue_past_noise": True} | how
    return richardson_lucy(build_observation(image, psf, 1e-3), iterations, **how).image.numpy()


def psnr(image, truth) -> float:
    return 10 * math.log10(1 / np.mean((image - truth) ** 2))


def ring_psf(factor: int) -> np.ndarray:
    """A ring, `factor` samples a pixel, on 25 pixels."""
    x = positions(25 * factor, 1 / factor)
    r = np.hypot(x[:, None], x[None, :])
    psf = np.exp(-((r - RADIUS) ** 2) / (2 * 0.7**2)) + 3 * np.exp(-(r**2) / (2 * 0.6**2))
    return psf / psf.sum()


@pytest.fixture(scope="module")
def blurred() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A picture, its blurred and noisy frame, and the PSF on pixels; a field beyond the frame."""
    whole = SIDE + 2 * MARGIN
    scene = natural_image(FINE * whole, FINE * whole, 1)
    seen = fftconvolve(scene, ring_psf(FINE), mode="same")
    frame = binned(seen, FINE)[MARGIN:-MARGIN, MARGIN:-MARGIN] / FINE**2
    truth = scene[FINE // 2 :: FINE, FINE // 2 :: FINE][MARGIN:-MARGIN, MARGIN:-MARGIN]
    noisy = frame + np.random.default_rng(2).normal(0, 1e-3, frame.shape)
    return truth, noisy, binned(ring_psf(FINE), FINE)


def comet() -> np.ndarray:
    """A PSF without any symmetry, so that it and its mirror image can't be mixed up."""
    psf = gaussian_psf(9, 1.0)
    psf += 0.7 * np.roll(psf, (2, 1), (0, 1)) + 0.3 * np.roll(psf, (-1, 2), (0, 1))
    return psf / psf.sum()


def inner(image: np.ndarray, margin: int = 12) -> np.ndarray:
    return np.asarray(image)[margin:-margin, margin:-margin]


@pytest.mark.parametrize("restore", [lambda b, h: filtered(b, h, 1e-3),
                                     lambda b, h: likeliest(b, h, 60)])  # fmt: skip
def test_a_known_blur_with_little_noise_is_undone(blurred, restore):
    truth, noisy, psf = blurred
    restored = restore(noisy, psf)
    before, after = psnr(inner(noisy), inner(truth)), psnr(inner(restored), inner(truth))
    assert after > before + 2


def test_richardson_lucy_is_as_good_as_scikit_images_inside_and_better_at_the_border(blurred):
    truth, noisy, psf = blurred
    ours = likeliest(noisy, psf, 30)
    peers = restoration.richardson_lucy(noisy, psf, 30, clip=False)
    assert psnr(inner(ours, 24), inner(truth, 24)) > psnr(inner(peers, 24), inner(truth, 24)) - 0.2
    assert psnr(ours, truth) > psnr(peers, truth) + 1


def test_richardson_lucy_leaves_no_rings_at_the_border(blurred):
    """The unknown surroundings cost no more than twice the error of the interior."""
    truth, noisy, psf = blurred
    error = np.abs(likeliest(noisy, psf, 40) - truth) ** 2
    rim = np.ones(error.shape, dtype=bool)
    rim[6:-6, 6:-6] = False
    assert math.sqrt(error[rim].mean()) <= 2 * math.sqrt(inner(error).mean())


@pytest.mark.parametrize("smooth", ["flat", "gradient"])
def test_the_weight_is_near_the_best_there_is(blurred, smooth):
    """Judged by the true error over all weights of a grid: at most 1 dB is lost."""
    truth, noisy, psf = blurred
    weights = np.logspace(-7, 1, 25)
    best = max(psnr(inner(filtered(noisy, psf, q, smooth)), inner(truth)) for q in weights)
    assert psnr(inner(filtered(noisy, psf, None, smooth)), inner(truth)) > best - 1


def test_no_filter_is_better_than_that_of_the_pictures_spectrum():
    """Of a picture whose power falls as the frequency to the power 3, seen whole."""
    rng, n, psf = np.random.default_rng(14), 128, gaussian_psf(9, 1.2)
    f = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n))
    f[0, 0] = np.inf
    scene = 5 + np.fft.irfft2(np.fft.rfft2(rng.standard_normal((n, n))) * 0.05 * f**-1.5, (n, n))
    corner = np.roll(np.pad(psf, (0, n - 9)), (-4, -4), (0, 1))
    frame = np.fft.irfft2(np.fft.rfft2(scene) * np.fft.rfft2(corner), (n, n))
    seen = build_observation(frame + rng.normal(0, 0.02, (n, n)), psf, None, "periodic")
    told = psnr(wiener(seen, None, "spectrum").image.numpy(), scene)
    for smooth in ("gradient", "flat"):
        for weight in np.logspace(-6, 1, 30):
            assert told > psnr(wiener(seen, weight, smooth).image.numpy(), scene) - 0.05


def test_more_noise_asks_for_a_larger_weight(blurred):
    _, noisy, psf = blurred
    ks = [wiener(build_observation(noisy, psf, v), None, "flat").weight for v in (1e-4, 3e-3, 3e-2)]
    assert ks[0] < ks[1] < ks[2]


def test_scales_of_picture_and_psf_do_not_move_the_best_weight(blurred):
    _, noisy, psf = blurred
    k = wiener(build_observation(noisy, psf, 1e-3), None, "flat").weight
    assert wiener(build_observation(50 * noisy, psf, 0.05), None, "flat").weight == k
    assert wiener(build_observation(noisy * 0.3, psf * 0.3, 3e-4), None, "flat").weight == k


def test_what_a_filter_leaves_unexplained_is_about_the_noise(blurred):
    _, noisy, psf = blurred
    assert 0.5 < wiener(build_observation(noisy, psf, 1e-3)).residual < 1.2
    assert (
        wiener(build_observation(noisy, psf[::-1, ::-1].copy() * 0.9, 1e-3), 1e-4, "flat").residual
        > 0
    )


def test_the_residual_is_what_blurring_again_leaves(blurred):
    """Worked out once somebody asks, from what is then let go."""
    _, noisy, psf = blurred
    restored = wiener(build_observation(noisy, psf, 1e-3, "periodic"), 1e-3, "flat")
    rows, columns = (np.arange(n) - n // 2 for n in psf.shape)
    kernel = np.zeros(noisy.shape)
    kernel[np.ix_(rows, columns)] = psf
    again = np.fft.ifft2(np.fft.fft2(kernel) * np.fft.fft2(restored.image.numpy())).real
    truth = np.sqrt(np.mean((again - noisy) ** 2)) / 1e-3
    assert callable(restored.residual_source)
    assert restored.residual == pytest.approx(truth, rel=1e-3)
    assert restored.residual_source == restored.residual


def test_a_filter_fills_dead_pixels(blurred):
    truth, noisy, psf = blurred
    dead = np.random.default_rng(11).random(noisy.shape) < 0.03
    broken = np.where(dead, 5.0, noisy)
    seen = build_observation(broken, psf, 1e-3, weights=(~dead).astype(np.float32))
    known, naive = wiener(seen).image, wiener(build_observation(broken, psf, 1e-3)).image
    whole = wiener(build_observation(noisy, psf, 1e-3)).image
    assert psnr(known.numpy(), truth) > psnr(whole.numpy(), truth) - 1.5
    assert psnr(known.numpy(), truth) > psnr(naive.numpy(), truth) + 5


@pytest.mark.parametrize("shape", [(11, 14), (12, 13)])
def test_wiener_tends_to_the_dense_solution_for_the_measured_pixels(shape):
    """x = (H* M H + K)^-1 H* M y with every matrix written out; K = 1 converges fast."""
    rng = np.random.default_rng(3)
    image, psf, k = rng.random(shape), rng.random((5, 5)), 1.0
    psf /= psf.sum()
    padded = blur_shape(shape, psf.shape)
    size = padded[0] * padded[1]
    blur = np.zeros((size, size))
    y, x = np.mgrid[: padded[0], : padded[1]]
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            source = ((y - dy) % padded[0]) * padded[1] + (x - dx) % padded[1]
            blur[(y * padded[1] + x).ravel(), source.ravel()] += psf[dy + 2, dx + 2]
    top, left = (p // 2 - n // 2 for p, n in zip(padded, shape, strict=True))
    frame = np.zeros(padded, dtype=bool)
    frame[top : top + shape[0], left : left + shape[1]] = True
    seen = blur[frame.ravel()]
    solution = np.linalg.solve(
        seen.T @ seen + k * np.eye(size), seen.T @ (image - image.mean()).ravel()
    )
    truth = solution.reshape(padded)[frame].reshape(shape) + image.mean()
    assert relative(filtered(image, psf, k), truth) <= 1e-3
    assert relative(filtered(image, psf, 1e-3 * k), truth) > 1e-2


@pytest.mark.parametrize("k", [1e-6, 0.1, 3.0])
def test_wiener_with_a_point_shrinks_the_detail_by_k(k):
    """H = 1: (image - mean) / (1 + K) + mean, everywhere."""
    image = natural_image(20, 21, 4)
    expected = (image - image.mean()) / (1 + k) + image.mean()
    assert relative(filtered(image, np.ones((1, 1)), k), expected) <= 1e-12


@pytest.mark.parametrize("restore", [lambda b, h: filtered(b, h, 0.01),
                                     lambda b, h: likeliest(b, h, 15)])  # fmt: skip
@pytest.mark.parametrize("share", [0.25, 1.0])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_constant_picture_stays_constant(restore, share, dtype):
    """What the PSF loses is given back: c / share, without any border."""
    image = np.full((24, 31), 5.0, dtype=dtype)
    restored = restore(image, (gaussian_psf(9, 2.0) * share).astype(dtype))
    assert restored.dtype == dtype
    assert np.allclose(restored, 5.0 / share, rtol=1e-4)


@pytest.mark.parametrize("restore", [lambda b, h: filtered(b, h, 0.01),
                                     lambda b, h: likeliest(b, h, 10)])  # fmt: skip
def test_a_psf_that_loses_light_only_scales_the_answer(restore):
    image, psf = natural_image(24, 25, 5), gaussian_psf(7, 1.5)
    assert relative(restore(image, 0.2 * psf), restore(image, psf) / 0.2) <= 1e-9


def test_wiener_keeps_the_mean(blurred):
    _, noisy, psf = blurred
    assert filtered(noisy, psf, 0.01).mean() == pytest.approx(noisy.mean(), rel=0.01)


@pytest.fixture
def stars() -> tuple[np.ndarray, np.ndarray]:
    """Points on a dark sky, blurred directly, no light at the border."""
    sky = np.zeros((48, 50))
    rng = np.random.default_rng(6)
    sky[rng.integers(18, 30, 12), rng.integers(18, 32, 12)] = rng.uniform(10, 100, 12)
    return sky, convolve2d(sky, comet(), mode="same")


@pytest.mark.parametrize("iterations", [1, 3, 10])
def test_richardson_lucy_equals_the_plain_algorithm_in_the_dark(stars, iterations):
    """x <- x H*(d / H x), written out with scipy's convolutions on a wide dark field."""
    _, image = stars
    psf = comet()
    wide = np.pad(image, 20)
    estimate = np.full(wide.shape, image.mean())
    for _ in range(iterations):
        ratio = wide / np.maximum(fftconvolve(estimate, psf, mode="same"), 1e-15)
        estimate = estimate * fftconvolve(ratio, psf[::-1, ::-1], mode="same")
    truth = estimate[20:-20, 20:-20]
    restored = likeliest(image, psf, iterations)
    assert relative(restored[8:-8, 8:-8], truth[8:-8, 8:-8]) <= 1e-3


def plainly(image, psf, iterations, weights, border) -> np.ndarray:
    """x <- x H*(w d / H x) / H*(w), of what H* reaches by a hundredth at least; written out with
    scipy's convolutions. What isn't reached keeps the mean light."""
    rows, columns = (n // 2 for n in psf.shape)
    inside = np.s_[rows:-rows, columns:-columns]
    scene = np.full(np.add(image.shape, np.subtract(psf.shape, 1)), (image * weights).sum())
    scene /= weights.sum() * psf.sum()
    reached = fftconvolve(weights, psf[::-1, ::-1])
    known = reached > 0.01 * reached.max()
    if border == "dark":
        beyond = np.ones(scene.shape, dtype=bool)
        beyond[inside] = False
        scene[beyond] = 0
    for _ in range(iterations):
        ratio = weights * image / fftconvolve(scene, psf, mode="valid")
        better = scene * fftconvolve(ratio, psf[::-1, ::-1])
        scene = np.divide(better, reached, out=scene, where=known)
    return scene[inside]


@pytest.mark.parametrize("border", ["unknown", "dark"])
@pytest.mark.parametrize("weight", [1.0, 1e-3])
def test_richardson_lucy_equals_the_plain_algorithm_of_what_was_measured(border, weight):
    """Of pixels of all weights, a common factor of which doesn't count, with a hole in the frame
    that is larger than the PSF: nothing tells of its middle."""
    rng = np.random.default_rng(20)
    image, weights = 1 + natural_image(40, 43, 3), rng.uniform(0.2, 2.0, (40, 43))
    weights[10:26, 12:30] = 0
    truth = plainly(image, comet(), 6, weights, border)
    seen = build_observation(image, comet(), 1e-3, border, weights * weight)
    restored = richardson_lucy(seen, 6, accelerate=False, continue_past_noise=True).image.numpy()
    assert relative(restored, truth) <= 1e-5
    level = (image * weights).sum() / weights.sum()
    assert restored[18, 21] == pytest.approx(level, rel=1e-6)
    assert abs(restored[11, 13] / level - 1) > 1e-3


def test_richardson_lucy_keeps_the_flux_and_makes_no_negative_light(stars):
    sky, image = stars
    restored = likeliest(image, 0.5 * comet(), 30)
    assert restored.min() >= 0
    assert 0.5 * restored.sum() == pytest.approx(image.sum(), rel=1e-3)
    assert relative(0.5 * restored, sky) < relative(image, sky)


def test_richardson_lucy_raises_the_likelihood_of_the_data(blurred):
    """The theorem of Shepp and Vardi: every pass makes Poisson data likelier."""
    _, noisy, psf = blurred
    padded = np.pad(psf, 0)

    def likelihood(iterations: int) -> float:
        # Judged in the interior, on what the restored frame itself predicts there.
        restored = likeliest(noisy, psf, iterations)
        predicted = inner(fftconvolve(restored, padded, mode="same"), 13)
        return float((inner(noisy, 13) * np.log(predicted) - predicted).sum())

    values = [likelihood(n) for n in (1, 2, 4, 8, 16)]
    assert all(b > a for a, b in itertools.pairwise(values))


def test_acceleration_does_the_work_of_several_iterations(blurred):
    """As likely after ten as the plain algorithm after twenty."""
    _, noisy, psf = blurred
    seen = build_observation(noisy, psf, 1e-3)
    fast = richardson_lucy(seen, 10, continue_past_noise=True)
    slow = richardson_lucy(seen, 20, accelerate=False, continue_past_noise=True)
    assert fast.residual < slow.residual


def test_it_ends_where_only_noise_is_left():
    """Going on makes detail of the noise: judged by the true error."""
    scene, psf = natural_image(80, 80, 12), gaussian_psf(9, 1.5)
    frame = fftconvolve(scene, psf, mode="valid")
    noisy = frame + np.random.default_rng(13).normal(0, 0.02, frame.shape)
    truth = scene[4:-4, 4:-4]
    ended = richardson_lucy(build_observation(noisy, psf, 0.02), 200)
    further = richardson_lucy(build_observation(noisy, psf, 0.02), 200, continue_past_noise=True)
    assert ended.converged
    assert ended.iterations < 100
    assert ended.residual == pytest.approx(1, abs=0.05)
    assert psnr(ended.image.numpy(), truth) > psnr(further.image.numpy(), truth) + 3


@pytest.mark.parametrize("prior", [{"total_variation": 0.005}, {"tikhonov": 0.02}])
def test_a_regulariser_keeps_noise_out(prior):
    scene, psf = natural_image(80, 80, 12), gaussian_psf(9, 1.5)
    frame = fftconvolve(scene, psf, mode="valid")
    noisy = frame + np.random.default_rng(13).normal(0, 0.02, frame.shape)
    with_it, without = likeliest(noisy, psf, 100, **prior), likeliest(noisy, psf, 100)
    assert psnr(with_it, scene[4:-4, 4:-4]) > psnr(without, scene[4:-4, 4:-4]) + 1


def test_negative_data_count_as_none(stars):
    _, image = stars
    psf = gaussian_psf(9, 1.4)
    dipped = image.copy()
    dipped[image < 1e-12] = -3.0
    clipped = np.maximum(dipped, 0)
    assert np.array_equal(likeliest(dipped, psf, 5), likeliest(clipped, psf, 5))


def test_integers_are_restored_like_their_floats(stars):
    _, image = stars
    whole = np.round(image * 100).astype(np.uint16)
    psf = gaussian_psf(9, 1.4).astype(np.float32)
    for restore in (lambda b: filtered(b, psf, 0.01), lambda b: likeliest(b, psf, 5)):
        assert relative(restore(whole), restore(whole.astype(np.float32))) <= 1e-6


def test_progress_is_reported_and_cancelling_stops():
    heard = []
    image, psf = np.ones((8, 8)), gaussian_psf(3, 1.0)
    likeliest(image, psf, 2, progress=Progress(lambda f, m: heard.append((f, m))))
    assert heard == [(0.0, "Richardson-Lucy 1/2"), (0.5, "Richardson-Lucy 2/2")]
    stopped = Progress()
    stopped.cancel()
    with pytest.raises(Cancelled):
        likeliest(image, psf, 2, progress=stopped)


def test_bad_arguments_are_refused_by_name():
    image, psf = np.ones((6, 7)), gaussian_psf(3, 1.0)
    bad = image.copy()
    bad[2, 3] = np.nan
    for k in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match=r"weight is .*; it must be positive"):
            filtered(image, psf, k)
    with pytest.raises(ValueError, match=r"penalty_kind is 'steep'; take one of gradient"):
        filtered(image, psf, 0.1, "steep")
    with pytest.raises(ValueError, match=r"iterations is 0; at least 1"):
        likeliest(image, psf, 0)
    with pytest.raises(ValueError, match=r"tikhonov is -1; give 0 or more"):
        likeliest(image, psf, 1, tikhonov=-1.0)
    for restore in (lambda b, h: filtered(b, h, 0.1), lambda b, h: likeliest(b, h, 1)):
        with pytest.raises(ValueError, match=r"image has 1 NaN or infinite values of 42"):
            restore(bad, psf)
        with pytest.raises(ValueError, match=r"psf sums to 0; it must send light somewhere"):
            restore(image, 0 * psf)
        with pytest.raises(ValueError, match=r"psf has NaN or infinite values; measure"):
            restore(image, psf * np.inf)
    with pytest.raises(ValueError, match=r"psf sums to -1"):
        require_psf(-torch.from_numpy(psf))


@pytest.mark.parametrize("n", [1, 2, 5, 8])
@pytest.mark.parametrize("length", [8, 9, 13, 40])
def test_the_continued_picture_keeps_its_place_and_has_no_jumps(n, length):
    """The picture in the middle; beyond it nothing exceeds the picture's own values."""
    image = torch.rand(n, n, dtype=torch.float64, generator=torch.Generator().manual_seed(n))
    whole = extend_periodically(image, (length, length))
    start = length // 2 - n // 2
    assert torch.equal(whole[start : start + n, start : start + n], image)
    assert whole.min() >= image.min() - 1e-12
    assert whole.max() <= image.max() + 1e-12


def test_next_to_the_picture_stands_its_mirror_image():
    """Beyond the last column, 19, of a ramp: 18 and 17, slowly blended; 19 isn't repeated."""
    ramp = torch.arange(20, dtype=torch.float64).expand(4, 20)
    whole = extend_periodically(ramp, (4, 120))[0, 50:]
    assert whole[19:23].tolist() == pytest.approx([19, 18, 17, 16], abs=0.05)
    assert extend_periodically(ramp, (4, 120))[0, 47:50].tolist() == pytest.approx(
        [3, 2, 1], abs=0.05
    )


def test_opposite_edges_of_the_continued_picture_meet():
    """A ramp of 20 steps: the seam between its ends is no steeper than a few of its steps."""
    ramp = torch.arange(20, dtype=torch.float64).expand(4, 20)
    whole = extend_periodically(ramp, (8, 60))
    seam = torch.roll(whole, 1, -1) - whole
    assert float(seam.abs().max()) < 3


@pytest.mark.parametrize("side", [4, 5, 12, 21])
def test_the_transfer_function_is_that_of_the_centred_psf(side):
    """The DFT sum with the origin at n // 2, written out; a larger PSF is wound around."""
    psf = np.random.default_rng(7).random((side, side))
    x = positions(side, 1.0)
    k, m = np.arange(9)[:, None], np.arange(6)[:, None]
    truth = np.exp(-2j * np.pi * k * x / 9) @ psf @ np.exp(-2j * np.pi * m * x / 10).T
    value = transfer_function(torch.from_numpy(psf), (9, 10)).numpy()
    assert relative(value, truth) <= 1e-12


def test_the_padded_shape_holds_the_picture_and_half_a_psf_on_each_side():
    rows, columns = blur_shape((100, 37), (24, 11))
    assert rows >= 124
    assert columns >= 48
    assert rows < 150
