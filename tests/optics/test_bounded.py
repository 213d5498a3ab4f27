"""L-BFGS-B against finite differences, a bounded least-squares solver, and splitting."""

import itertools
import math

import numpy as np
import pytest
import torch
from judges import natural_image
from scipy.optimize import lsq_linear
from sweeps import some
from test_operators import matrix, operators
from test_total_variation import blurred, comet, disk, photograph, psnr, seen

from optics.inverse import Mask, SpectralMosaic, filter_weights
from optics.inverse.bounded import (
    SMOOTH_PRIORS,
    Misfit,
    Smoothness,
    minimise_within_bounds,
    restore_within_bounds,
)
from optics.inverse.total_variation import total_variation
from optics.progress import Cancelled, Progress

NAMES = ["blur", "unknown border", "field", "mosaic", "bands blurred, then through a mosaic"]


def numbers(*shape, seed=0):
    return torch.from_numpy(np.random.default_rng([seed, *shape]).standard_normal(shape))


def slope_error(function, x):
    """Of a gradient against central differences along random ways, relative."""
    _, gradient = function(x)
    worst = 0.0
    for seed in range(4):
        way, step = numbers(*x.shape, seed=seed + 20), 1e-5
        rise = float(function(x + step * way)[0] - function(x - step * way)[0]) / (2 * step)
        worst = max(worst, abs(rise - float((gradient * way).sum())) / abs(rise))
    return worst


@pytest.mark.parametrize("around", [True, False])
@pytest.mark.parametrize("prior", SMOOTH_PRIORS)
def test_gradients_of_priors_are_those_of_finite_differences(prior, around):
    assert slope_error(Smoothness(prior, 0.05, around), numbers(2, 6, 7, seed=1)) < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_gradients_of_misfits_are_those_of_finite_differences(name):
    a = operators((7, 6))[name]
    y = numbers(*a.codomain, seed=2)
    misfit = Misfit(a, y, y.abs(), y > 0.5)
    assert slope_error(misfit, numbers(*a.domain, seed=3)) < 1e-5


@pytest.mark.parametrize("name", NAMES)
def test_the_minimum_is_that_of_a_dense_bounded_solver(name):
    """Tikhonov's and the gradient's priors as rows of a least-squares problem."""
    a = operators((6, 5))[name]
    truth, weight = numbers(*a.domain, seed=4).abs(), 0.02
    y = a(truth) + 0.05 * numbers(*a.codomain, seed=5)
    trust = numbers(*a.codomain, seed=6).abs()
    low = 0.1 * numbers(*a.domain, seed=7).abs()
    high = low + 0.9
    size = math.prod(a.domain)
    rows = trust.sqrt().reshape(-1, 1) * matrix(a)
    for prior in ("tikhonov", "gradient"):
        found = minimise_within_bounds(
            a, y, weight, prior, lower=low, upper=high, weights=trust, iterations=3000, tol=1e-9
        )
        unit = torch.eye(size, dtype=torch.float64).reshape(size, *a.domain)
        down, along = torch.zeros_like(unit), torch.zeros_like(unit)
        down[..., :-1, :] = unit[..., 1:, :] - unit[..., :-1, :]
        along[..., :-1] = unit[..., 1:] - unit[..., :-1]
        extra = [unit] if prior == "tikhonov" else [down, along]
        stacked = torch.cat([rows, *(math.sqrt(weight) * e.reshape(size, -1).T for e in extra)])
        wanted = torch.zeros(len(stacked), dtype=torch.float64)
        wanted[: len(rows)] = (trust.sqrt() * y).flatten()
        best = lsq_linear(
            stacked.numpy(), wanted.numpy(), (low.flatten().numpy(), high.flatten().numpy()),
            tol=1e-14,
        )  # fmt: skip
        assert found.objective == pytest.approx(best.cost, rel=1e-6)
        assert found.value.flatten().numpy() == pytest.approx(best.x, abs=2e-3)
        assert bool((found.value >= low).all())
        assert bool((found.value <= high).all())


def test_a_shorter_smoothing_leads_to_the_unrounded_minimum():
    """Found by splitting; and no further from it than the rounding may be."""
    psf, scene, weight = comet(), natural_image(12, 13, 4), 2e-3
    blur = np.fft.fft2(np.roll(np.pad(psf, ((0, 7), (0, 8))), (-2, -2), (0, 1)))
    frame = np.fft.ifft2(np.fft.fft2(scene) * blur).real
    frame += np.random.default_rng(5).normal(0, 0.01, frame.shape)
    problem = seen(frame, psf, 0.01, "periodic")
    split = total_variation(problem, weight, iterations=1200).period_image.double().numpy()

    def cost(x):
        left = np.fft.ifft2(np.fft.fft2(x) * blur).real - frame
        down, along = np.roll(x, -1, 0) - x, np.roll(x, -1, 1) - x
        return (left**2).sum() / 2 + weight * np.hypot(down, along).sum()

    excess = []
    for smoothing in (1e-2, 1e-3, 1e-4):
        found = restore_within_bounds(
            problem, weight, smoothing=smoothing, lower=-math.inf, iterations=4000, tol=1e-6
        )
        excess.append(cost(found.period_image.double().numpy()) - cost(split))
        assert excess[-1] <= weight * smoothing * scene.size
    assert excess[0] > excess[1] > excess[2]
    assert abs(excess[-1]) < 1e-3 * cost(split)


def test_an_unknown_border_restores_as_well_as_splitting_does():
    psf = disk(3.0)
    truth, frame = blurred(photograph(96), psf, 0.01)
    problem = seen(frame, psf)
    ours, split = restore_within_bounds(problem, upper=1.0), total_variation(problem)
    assert psnr(ours.image, truth) > psnr(split.image, truth) - 0.4
    assert ours.weight == pytest.approx(split.weight, rel=0.3)
    assert 0.8 < ours.residual < 1.1
    assert float(ours.image.min()) >= 0
    assert float(ours.image.max()) <= 1


@pytest.mark.parametrize(
    ("border", "prior"),
    some(itertools.product(["unknown", "dark", "periodic"], SMOOTH_PRIORS), 0, 4, 8),
)
def test_every_border_and_prior_ends_converged_and_finite(border, prior):
    _, frame = blurred(photograph(48), comet(), 0.01)
    done = restore_within_bounds(seen(frame, comet(), 0.01, border), prior=prior)
    assert done.converged
    assert np.isfinite(done.image.numpy()).all()
    assert done.image.shape == frame.shape


def test_bounds_of_each_pixel_hold_and_help():
    psf = disk(3.0)
    truth, frame = blurred(photograph(64), psf, 0.02)
    problem = seen(frame, psf, 0.02)
    free = restore_within_bounds(problem, 1e-4)
    near = restore_within_bounds(
        problem, 1e-4, lower=np.maximum(truth - 0.05, 0), upper=truth + 0.05
    )
    assert (near.image.numpy() >= np.maximum(truth - 0.05, 0) - 1e-6).all()
    assert (near.image.numpy() <= truth + 0.05 + 1e-6).all()
    assert psnr(near.image, truth) > psnr(free.image, truth) + 3


def test_clipped_pixels_pull_upwards_only():
    """Of one pixel each: the least of (x - 1)² / 2 + w x² / 2 where it is measured, and at least 1
    where it's full, though something brighter is known of it."""
    a = Mask(torch.ones(2, 2))
    y = torch.ones(2, 2)
    full = torch.tensor([[True, False], [True, False]])
    start = torch.tensor([[5.0, 5.0], [0.0, 0.0]])
    found = minimise_within_bounds(a, y, 0.0, "tikhonov", clipped=full, start=start, tol=1e-8).value
    assert found[:, 1].numpy() == pytest.approx(1.0)
    assert float(found[0, 0]) == pytest.approx(5.0)
    assert float(found[1, 0]) == pytest.approx(1.0)


def test_colours_behind_a_mosaic_are_looked_for_within_bounds():
    """Thesis Eq. 4.7: one band seen through three filters, by the Sobolev prior."""
    scene = photograph(48)
    sees = filter_weights(("RG", "GB"), torch.tensor([[0.9], [0.5], [0.2]]), "RGB", scene.shape)
    raw = (sees[0].numpy() * scene).astype(np.float32)
    raw += np.random.default_rng(1).normal(0, 0.005, raw.shape).astype(np.float32)
    found = minimise_within_bounds(SpectralMosaic(sees), raw, 1e-3, "gradient", upper=1.0)
    assert found.converged
    assert psnr(found.value[0], scene) > 33


def test_progress_is_told_and_a_cancel_stops_it():
    _, frame = blurred(photograph(48), comet(), 0.01)
    heard = []
    progress = Progress(lambda fraction, message: heard.append((fraction, message)))
    restore_within_bounds(seen(frame, comet(), 0.01), 1e-3, iterations=5, progress=progress)
    assert [round(5 * fraction) for fraction, _ in heard] == [1, 2, 3, 4, 5]
    assert heard[-1][1] == "L-BFGS-B 5/5"

    def stop(fraction, message):
        if fraction > 0.3:
            later.cancel()

    later = Progress(stop)
    with pytest.raises(Cancelled):
        restore_within_bounds(
            seen(frame, comet(), 0.01), 1e-3, iterations=50, tol=1e-9, progress=later
        )


@pytest.mark.parametrize("frame", [np.zeros((20, 21)), np.full((20, 21), 0.3), np.eye(9) - 0.5])
@pytest.mark.parametrize("prior", SMOOTH_PRIORS)
def test_pictures_without_detail_or_light_stay_finite(frame, prior):
    done = restore_within_bounds(seen(frame, comet(), 0.1), prior=prior, iterations=30)
    assert np.isfinite(done.image.numpy()).all()


ONE = Mask(torch.ones(4, 5))
FLAT = torch.full((4, 5), 0.5)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: minimise_within_bounds(ONE, FLAT, -1.0), "weight is -1"),
    (lambda: minimise_within_bounds(ONE, FLAT, math.nan), "weight is nan"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, "wavelets"), "prior is 'wavelets'"),
    (lambda: minimise_within_bounds(ONE, FLAT[:3], 1.0), r"data are \(3, 5\)"),
    (lambda: minimise_within_bounds(ONE, FLAT * math.nan, 1.0), "data has 20 NaN"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, lower=1.0, upper=0.5), "lower is above upper"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, lower=math.nan), "or NaN, at 20"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, smoothing=0.0), "smoothing is 0"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, iterations=0), "iterations is 0"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, tol=0.0), "tol is 0"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, start=FLAT[0]), r"start is \(5,\)"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, weights=FLAT[:2]), "weights is"),
    (lambda: minimise_within_bounds(ONE, FLAT, 1.0, weights=0 * FLAT), "positive somewhere"),
    (lambda: minimise_within_bounds(Mask(torch.zeros(4, 5)), FLAT, 1.0), "nothing through"),
    (lambda: restore_within_bounds(seen(np.eye(9), comet()), prior="none"), "prior is 'none'"),
    (lambda: restore_within_bounds(seen(np.eye(9), comet()), lower=np.zeros((3, 3))), "lower is"),
])  # fmt: skip
def test_what_doesnt_fit_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()
