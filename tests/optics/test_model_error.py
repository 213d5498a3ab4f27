"""The error of a PSF, told from a photograph's spectrum, and what restorations make of it."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve
from skimage import data
from sweeps import some

from optics.inverse import restore
from optics.inverse.observation_builder import build_observation
from optics.inverse.total_variation import total_variation

NOISE = 0.0015


def shake(seed: int, side: int = 15) -> np.ndarray:
    """A kernel as a camera that shakes makes it: a smooth random walk."""
    rng = np.random.default_rng(seed)
    path = np.cumsum(gaussian_filter(rng.normal(size=(400, 2)), (20, 0)), axis=0)
    path = (path - path.mean(0)) / np.abs(path - path.mean(0)).max() * (side // 2 - 1)
    psf = np.zeros((side, side))
    np.add.at(psf, tuple(np.round(path + side // 2).astype(int).T), 1.0)
    psf = gaussian_filter(psf, 0.6)
    return psf / psf.sum()


def peaked_ring() -> np.ndarray:
    """A ring of 12 pixels around a peak with three tenths of the light."""
    y, x = np.mgrid[:33, :33] - 16
    ring = np.exp(-0.5 * ((np.hypot(y, x) - 12) / 0.7) ** 2)
    return 0.7 * ring / ring.sum() + 0.3 * ((y == 0) & (x == 0))


def disturb(psf: np.ndarray, share: float, seed: int) -> np.ndarray:
    """As a measured kernel is: every value is wrong by some share, and neighbours alike."""
    rng = np.random.default_rng(seed)
    error = gaussian_filter(rng.normal(size=psf.shape), 0.7)
    wrong = (psf * (1 + share * error / error.std())).clip(min=0)
    return wrong / wrong.sum()


def capture(scene: np.ndarray, psf: np.ndarray, noise: float, seed: int = 0):
    frame = fftconvolve(scene, psf, mode="valid")
    top, left = (m - 1 - m // 2 for m in psf.shape)
    truth = scene[top : top + frame.shape[0], left : left + frame.shape[1]]
    return truth, frame + np.random.default_rng(seed).normal(0, noise, frame.shape)


def psnr(image, truth) -> float:
    return -10 * math.log10(np.mean((np.asarray(image) - truth) ** 2))


def photographs() -> list[np.ndarray]:
    return [
        data.camera()[100:360, 120:380] / 255.0,
        data.astronaut()[0:260, 100:360].mean(-1) / 255.0,
        data.coffee()[60:320, 150:410].mean(-1) / 255.0,
    ]


@pytest.mark.parametrize("noise", [NOISE, 0.01])
@pytest.mark.parametrize("number", range(3))
def test_an_exact_kernel_has_no_error(number, noise):
    _, frame = capture(photographs()[number], shake(number), noise)
    law = build_observation(frame, shake(number), None).power_law
    assert law.model_error_variance == 0
    assert math.sqrt(law.noise_variance) == pytest.approx(noise, rel=0.1)


@pytest.mark.parametrize("method", some(["wiener", "total-variation", "hyper-laplacian"]))
def test_a_wrong_kernel_is_noticed_and_restored_better_than_without(method):
    gains = []
    for number, scene in enumerate(photographs()):
        psf = shake(number)
        truth, frame = capture(scene, psf, NOISE)
        measured = disturb(psf, 0.6, number)
        seen = build_observation(frame, measured, None)
        assert seen.power_law.model_error_variance > 0
        assert seen.disturbance > 1.2 * NOISE
        believed = build_observation(frame, measured, None)
        own = believed.in_own_unit
        own.__dict__["power_law"] = replace(own.power_law, model_error_variance=0.0)
        gains.append(
            psnr(restore(seen, method=method).image, truth)
            - psnr(restore(believed, method=method).image, truth)
        )
    assert min(gains) > 0
    assert np.mean(gains) > 0.5


def test_told_noise_is_taken_as_told_and_the_error_is_added_to_it():
    _, frame = capture(photographs()[0], shake(0), NOISE)
    found, told = (
        build_observation(frame, disturb(shake(0), 0.6, 0), noise) for noise in (None, 0.02)
    )
    assert told.scene_noise == pytest.approx(0.02)
    error = math.sqrt(found.power_law.model_error_variance)
    assert told.disturbance == pytest.approx(math.hypot(0.02, error))
    exact = build_observation(frame, shake(0), 0.02)
    assert exact.disturbance == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("factor", "number"), some(itertools.product([0.95, 1.05], range(3)), 0, 4)
)
def test_noise_that_is_told_a_twentieth_wrong_costs_next_to_nothing(factor, number):
    truth, frame = capture(photographs()[number], shake(number), 0.01)
    right, wrong = (
        psnr(restore(build_observation(frame, shake(number), noise)).image, truth)
        for noise in (0.01, factor * 0.01)
    )
    assert wrong > right - 0.3


def test_clipped_pixels_arent_taken_for_an_error_of_the_kernel():
    scene = photographs()[0].copy()
    for y, x in np.random.default_rng(3).integers(10, 250, (20, 2)):
        scene[y : y + 3, x : x + 3] = 8.0
    _, frame = capture(scene, shake(0), NOISE)
    clipped = frame > 1
    seen = build_observation(frame.clip(max=1), shake(0), None, clipped=clipped)
    assert seen.power_law.model_error_variance == 0


@pytest.mark.parametrize("number", some(range(3)))
def test_noise_isnt_lost_where_the_kernel_keeps_all_detail(number):
    """A kernel with a strong peak has no zeros: the power law alone took the noise for detail."""
    psf = peaked_ring()
    truth, frame = capture(photographs()[number], psf, 0.005)
    seen = build_observation(frame, psf, None)
    assert 0.5 * 0.005 < seen.noise < 2 * 0.005
    assert psnr(restore(seen).image, truth) > psnr(frame, truth) + 3


def test_a_wide_kernel_ends_near_its_limit_beyond_the_frame_too():
    """In the default number of iterations, against five times as many of the same problem."""
    psf = peaked_ring()
    truth, frame = capture(photographs()[2][:210, :210], psf, 0.003)
    seen = build_observation(frame, psf, 0.003)
    soon = restore(seen)
    late = total_variation(seen, soon.weight, iterations=300)
    assert soon.iterations == 60
    assert psnr(soon.image, truth) > psnr(late.image, truth) - 0.9


def test_tiny_and_constant_frames_have_a_finite_law():
    rng = np.random.default_rng(0)
    for shape in ((3, 3), (8, 40), (17, 18), (40, 41)):
        for frame in (rng.random(shape), np.zeros(shape), np.ones(shape)):
            law = build_observation(frame, np.ones((3, 3)) / 9, None).power_law
            assert math.isfinite(law.total_variance)
            assert law.total_variance >= 0
