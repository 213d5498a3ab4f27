"""Photons' likelihood with total variation: against another minimiser, and its optimality."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import convolve
from scipy.optimize import minimize
from scipy.signal import fftconvolve

from optics.inverse.observation_builder import build_observation
from optics.inverse.poisson import poisson_total_variation
from optics.inverse.total_variation import total_variation

PSF = np.array([[0.05, 0.1, 0.05], [0.1, 0.4, 0.1], [0.05, 0.1, 0.05]])
WEIGHT = 0.8


def seen_as(picture):
    """Blurred on a period by SciPy; the PSF is even, so that this is its own adjoint."""
    return convolve(picture, PSF, mode="wrap")


def lengths(picture, smooth=0.0):
    down, along = (np.roll(picture, -1, axis) - picture for axis in (0, 1))
    return np.sqrt(down**2 + along**2 + smooth**2), down, along


def objective(picture, counts, trust):
    """Of a picture that sends light wherever photons were counted."""
    light = np.maximum(seen_as(picture), 1e-300)
    mean = (trust * counts).sum() / trust.sum()
    misfit = trust * (light - counts * np.log(light))
    return mean * misfit.sum() + WEIGHT * lengths(picture)[0].sum()


def minimised(counts, trust):
    """By L-BFGS-B, with gradients' lengths rounded by ever less."""
    mean = (trust * counts).sum() / trust.sum()
    found = np.full(counts.shape, mean)
    for smooth in (1.0, 0.1, 0.01, 1e-3):

        def valued(flat, smooth=smooth):
            picture = flat.reshape(counts.shape)
            light = np.maximum(seen_as(picture), 1e-9)
            length, down, along = lengths(picture, smooth)
            value = mean * (trust * (light - counts * np.log(light))).sum()
            slope = mean * seen_as(trust * (1 - counts / light))
            down, along = down / length, along / length
            slope += WEIGHT * (np.roll(down, 1, 0) - down + np.roll(along, 1, 1) - along)
            return value + WEIGHT * length.sum(), slope.ravel()

        bounds = [(1e-6, None)] * counts.size
        done = minimize(
            valued, found.ravel(), jac=True, method="L-BFGS-B", bounds=bounds,
            options={"maxiter": 5000, "maxfun": 10000, "ftol": 1e-15, "gtol": 1e-9},
        )  # fmt: skip
        found = done.x.reshape(counts.shape)
    return found


@pytest.fixture(scope="module")
def small():
    """Photons of a bright square on a dim ground, 12 x 14, some pixels dead."""
    rng = np.random.default_rng(3)
    scene = np.full((12, 14), 4.0)
    scene[3:8, 4:10] = 40.0
    counts = rng.poisson(seen_as(scene)).astype(float)
    trust = np.ones_like(counts)
    trust[2, 3] = trust[9, 11] = 0
    return counts, trust


def restored(counts, trust, **how):
    seen = build_observation(counts, PSF, 1.0, "periodic", weights=trust)
    return poisson_total_variation(seen, WEIGHT, iterations=2000, positive=True, **how)


@pytest.fixture(scope="module")
def ours(small):
    return restored(*small).image.numpy()


def test_it_is_the_least_of_its_objective(small, ours):
    counts, trust = small
    theirs = minimised(counts, trust)
    least = objective(theirs, counts, trust)
    assert objective(ours, counts, trust) <= least + 1e-4 * abs(least)
    assert np.linalg.norm(ours - theirs) <= 0.01 * np.linalg.norm(theirs)


def test_no_brighter_and_no_darker_picture_is_likelier(small, ours):
    """Scaled: m (sum H x - sum y) + w TV(x) = 0. Raised all over: the sum of 1 - y / H x is 0."""
    counts, trust = small
    light, mean = seen_as(ours), (trust * counts).sum() / trust.sum()
    kept = (trust * light).sum() + WEIGHT * lengths(ours)[0].sum() / mean
    assert kept == pytest.approx((trust * counts).sum(), rel=1e-3)
    assert abs((trust * (1 - counts / light)).sum()) <= 1e-3 * trust.sum()


def test_few_photons_are_restored_better_than_by_squares():
    """Disks of 10 to 200 photons a pixel, seen beyond the frame as well; all is estimated."""
    psf, ours, squares = np.full((7, 7), 1 / 49), [], []
    for seed in (4, 5, 6, 7):
        rng = np.random.default_rng(seed)
        y, x = np.mgrid[:70, :76].astype(float)
        scene = 10 + 20 * x / 76
        for _ in range(12):
            cy, cx, r = rng.uniform((0, 0, 4), (70, 76, 18))
            scene[np.hypot(y - cy, x - cx) < r] = rng.uniform(10, 200)
        frame = rng.poisson(fftconvolve(scene, psf, "valid")).astype(np.float32)
        sharp = scene[3:-3, 3:-3]
        for way, found in ((poisson_total_variation, ours), (total_variation, squares)):
            left = np.linalg.norm(way(build_observation(frame, psf)).image.numpy() - sharp)
            found.append(left / np.linalg.norm(frame - sharp))
    assert np.mean(ours) < 0.95 * np.mean(squares)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_no_light_one_photon_and_even_light(dtype):
    for level in (0.0, 1e-30, 7.0):
        even = poisson_total_variation(
            build_observation(np.full((20, 21), level, dtype), PSF)
        ).image
        assert np.allclose(even.numpy(), level, rtol=1e-4, atol=1e-35)
    one = np.zeros((20, 21), dtype)
    one[9, 11] = 1
    picture = poisson_total_variation(
        build_observation(one, PSF, border="periodic"), 1e-4, iterations=300, positive=True
    ).image.numpy()
    assert np.isfinite(picture).all()
    assert picture.min() >= 0
    assert np.unravel_index(picture.argmax(), picture.shape) == (9, 11)
    # No light is lost but what the weight takes, over the mean light.
    taken = 1e-4 * lengths(picture)[0].sum() * one.size
    assert picture.sum() + taken == pytest.approx(1, rel=0.02)


def test_a_full_well_is_at_least_as_bright():
    scene = np.full((24, 24), 10.0)
    scene[10:14, 10:14] = 400.0
    light = seen_as(scene)
    clipped = light >= 100
    seen = build_observation(np.minimum(light, 100), PSF, 0.1, "periodic", clipped=clipped)
    picture = poisson_total_variation(seen, 1e-3, iterations=400).image.numpy()
    assert seen_as(picture)[clipped].min() >= 95
    assert np.abs(seen_as(picture) - light)[:5].max() < 0.2


@pytest.mark.parametrize(
    ("how", "message"),
    [({"weight": 0.0}, "weight"), ({"iterations": 0}, "iterations is 0; at least 1")],
)
def test_what_can_not_be_asked(how, message):
    with pytest.raises(ValueError, match=message):
        poisson_total_variation(build_observation(np.ones((9, 9)), PSF), **how)
