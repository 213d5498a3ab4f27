"""Shrinkage against trial of every length; restoration against another solver of its problem."""

import math

import numpy as np
import pytest
import torch
from judges import natural_image
from test_total_variation import blurred, comet, disk, photograph, psnr, seen

from optics.inverse.hyper_laplacian import hyper_laplacian, shrinkage_factor
from optics.inverse.wiener import wiener
from optics.progress import Cancelled, Progress


def shrink(values, power, coupling):
    return values * shrinkage_factor(torch.tensor(values).square(), power, coupling).numpy()


@pytest.mark.parametrize("coupling", [0.1, 1.0, 50.0])
@pytest.mark.parametrize("power", [0.3, 0.5, 2 / 3, 0.8, 1.0])
def test_shrinkage_finds_the_least_of_all_lengths(power, coupling):
    values = np.linspace(-5, 5, 401) * coupling ** (-1 / (2 - power))
    tried = np.linspace(0, 1, 4001)

    def cost(length, value):
        return np.abs(length) ** power + coupling / 2 * (length - value) ** 2

    found = shrink(values, power, coupling)
    assert np.isfinite(found).all()
    best = np.array([cost(tried * value, value).min() for value in values])
    assert (cost(found, values) <= best * (1 + 1e-6) + 1e-12).all()
    # Neither everything nor nothing is shrunk to zero.
    assert 0.05 < (found == 0).mean() < 0.95


def test_soft_thresholding_is_the_case_of_power_one():
    values = np.linspace(-3, 3, 61)
    expected = np.sign(values) * np.maximum(np.abs(values) - 0.5, 0)
    assert shrink(values, 1.0, 2.0) == pytest.approx(expected, abs=1e-6)


def test_shrinkage_of_a_half_has_a_closed_form():
    """With v = s², a root of s³ - |w| s + 1 / (2 beta) (Krishnan and Fergus 2009)."""
    for value, beta in ((2.0, 1.0), (3.0, 0.7), (0.5, 40.0)):
        roots = np.roots([1.0, 0.0, -value, 0.5 / beta])
        largest = max(roots.real[np.abs(roots.imag) < 1e-9]) ** 2
        assert float(shrink(np.array([value]), 0.5, beta)[0]) == pytest.approx(largest, rel=1e-5)


def objective(x, psf, frame, weight, power):
    """Of a period that was seen whole."""
    transfer = spectrum(psf, frame.shape)
    left = np.fft.ifft2(np.fft.fft2(x) * transfer).real - frame
    down, along = np.roll(x, -1, 0) - x, np.roll(x, -1, 1) - x
    return (left**2).sum() / 2 + weight * (np.hypot(down, along) ** power).sum()


def spectrum(psf, shape):
    padded = np.pad(psf, [(0, n - m) for n, m in zip(shape, psf.shape, strict=True)])
    return np.fft.fft2(np.roll(padded, [-(m // 2) for m in psf.shape], (0, 1)))


def reweighted(psf, frame, weight, power, rounds=30, steps=40):
    """Iteratively reweighted least squares, by conjugate gradients, with a falling floor."""
    transfer, x = spectrum(psf, frame.shape), frame.copy()
    data = np.fft.ifft2(np.fft.fft2(frame) * transfer.conj()).real
    for floor in np.logspace(-1, -4, rounds):
        down, along = np.roll(x, -1, 0) - x, np.roll(x, -1, 1) - x
        worth = weight * power * (down**2 + along**2 + floor**2) ** (power / 2 - 1)

        def normal(z, worth=worth):
            dy, dx = worth * (np.roll(z, -1, 0) - z), worth * (np.roll(z, -1, 1) - z)
            back = np.roll(dy, 1, 0) - dy + np.roll(dx, 1, 1) - dx
            return np.fft.ifft2(np.fft.fft2(z) * np.abs(transfer) ** 2).real + back

        left = data - normal(x)
        way, length = left.copy(), (left**2).sum()
        for _ in range(steps):
            bent = normal(way)
            far = length / (way * bent).sum()
            x, left = x + far * way, left - far * bent
            before, length = length, (left**2).sum()
            way = left + length / before * way
    return x


@pytest.mark.parametrize("power", [0.5, 0.8])
def test_it_ends_about_as_low_as_reweighted_least_squares(power):
    psf, scene, weight = comet(), natural_image(32, 34, 4), 5e-4
    frame = np.fft.ifft2(np.fft.fft2(scene) * spectrum(psf, scene.shape)).real
    frame += np.random.default_rng(5).normal(0, 0.01, frame.shape)
    problem = seen(frame, psf, 0.01, "periodic")
    costs = {
        rounds: objective(
            hyper_laplacian(problem, power, weight, rounds=rounds).period_image.double().numpy(),
            psf, frame, weight, power,
        )
        for rounds in (4, 10, 40)
    }  # fmt: skip
    slow = objective(reweighted(psf, frame, weight, power), psf, frame, weight, power)
    start = objective(wiener(problem).image.double().numpy(), psf, frame, weight, power)
    assert costs[40] <= costs[10] * 1.01
    assert costs[10] <= costs[4] * 1.01
    assert costs[40] < 1.1 * slow
    assert costs[10] < 0.97 * start


@pytest.mark.parametrize("border", ["unknown", "periodic", "dark"])
def test_it_restores_without_being_told_noise_or_weight(border):
    psf = disk(3.0)
    truth, frame = blurred(photograph(), psf, 0.01)
    if border == "periodic":
        scene = photograph()
        frame = np.fft.ifft2(np.fft.fft2(scene) * spectrum(psf, scene.shape)).real
        frame += np.random.default_rng(0).normal(0, 0.01, scene.shape)
        truth = scene
    done = hyper_laplacian(seen(frame, psf, None, border))
    assert np.isfinite(done.image.numpy()).all()
    if border == "dark":
        return
    problem = seen(frame, psf, 0.01, border)
    best = max(psnr(hyper_laplacian(problem, weight=w).image, truth) for w in
               (3e-5, 6e-5, 1.2e-4, 2.5e-4, 5e-4))  # fmt: skip
    assert psnr(done.image, truth) > psnr(frame, truth) + 2
    assert psnr(done.image, truth) > best - 0.6
    assert 0.8 < done.residual < 1.1


def test_dead_pixels_and_units_of_light_dont_matter():
    psf = disk(3.0)
    truth, frame = blurred(photograph(96), psf, 0.01)
    dead = np.random.default_rng(8).random(frame.shape) < 0.05
    weights = (~dead).astype(np.float32)
    whole = hyper_laplacian(seen(frame, psf, 0.01)).image
    known = hyper_laplacian(seen(np.where(dead, 3.0, frame), psf, 0.01, weights=weights)).image
    assert psnr(known, truth) > psnr(whole, truth) - 0.4
    bright = hyper_laplacian(seen(3000 * frame, 0.5 * psf, 30.0)).image / 6000
    assert psnr(bright, whole.numpy()) > 45


@pytest.mark.parametrize("frame", [np.zeros((20, 21)), np.full((20, 21), 0.3), np.eye(9) - 0.5])
@pytest.mark.parametrize("power", [0.5, 1.0])
def test_pictures_without_detail_or_light_stay_finite(frame, power):
    done = hyper_laplacian(seen(frame, comet()), power)
    assert np.isfinite(done.image.numpy()).all()
    assert math.isfinite(done.residual)


@pytest.mark.parametrize(("make", "words"), [
    (lambda p: hyper_laplacian(p, 0.0), "power is 0"),
    (lambda p: hyper_laplacian(p, 1.2), "power is 1.2"),
    (lambda p: hyper_laplacian(p, math.nan), "power is nan"),
    (lambda p: hyper_laplacian(p, weight=-1.0), "weight is -1"),
    (lambda p: hyper_laplacian(p, rounds=1), "rounds is 1"),
])  # fmt: skip
def test_what_doesnt_fit_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make(seen(np.full((8, 9), 0.5), comet(), 0.1))


def test_it_can_be_cancelled():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        hyper_laplacian(seen(np.eye(9), comet(), 0.1), progress=progress)
