"""Histograms, mixtures and generalised Gaussians against closed forms, samples and photographs."""

import math

import numpy as np
import pytest
import torch
from scipy import stats
from skimage import data

from optics.inverse.gradient_statistics import (
    LIGHT_DEVIATION,
    NATURAL_GRADIENTS,
    GaussianMixture,
    GeneralisedGaussian,
    fit_generalised_gaussian,
    fit_mixture,
    gradients,
    log_histogram,
)

MIXTURE = GaussianMixture((0.7, 0.3), (0.02, 0.15))


def picture_of(steps: np.ndarray) -> np.ndarray:
    """Whose gradients along x, and no others, are given: every row the same walk."""
    return np.tile(np.concatenate([[0.0], np.cumsum(steps)]), (3, 1))


def drawn(mixture: GaussianMixture, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    which = rng.choice(len(mixture.shares), count, p=mixture.shares)
    return rng.normal(0, np.array(mixture.deviations)[which])


def sharp() -> np.ndarray:
    grey = data.camera() / 255.0
    return grey * LIGHT_DEVIATION / grey.std()


def test_the_density_of_a_mixture_is_that_of_its_parts():
    x = np.linspace(-3, 3, 600_001)
    density = sum(
        share * stats.norm.pdf(x, scale=deviation)
        for share, deviation in zip(MIXTURE.shares, MIXTURE.deviations, strict=True)
    )
    told = MIXTURE.log_density(torch.from_numpy(x)).exp().numpy()
    assert told[::6000] == pytest.approx(density[::6000], rel=1e-9)


@pytest.mark.parametrize("power", [0.5, 1, 2])
def test_a_generalised_gaussian_is_that_of_scipy(power):
    ours, theirs = GeneralisedGaussian(0.3, 0.7), stats.gennorm(0.7, scale=0.3)
    x = np.array([-1.0, 0.01, 0.2, 2.0])
    assert ours.log_density(torch.from_numpy(x)).numpy() == pytest.approx(theirs.logpdf(x))
    if power > 0.9:
        expected = theirs.moment(2) if power == 2 else theirs.expect(np.abs, epsabs=1e-10)
        assert ours.moment(power) == pytest.approx(expected, rel=1e-4)


def test_gradients_of_a_ramp():
    image = torch.arange(5.0)[None, :] * 2 + torch.arange(4.0)[:, None] * 3
    along, down = gradients(image)
    assert along.shape == (3, 4)
    assert bool((along == 2).all())
    assert bool((down == 3).all())


def test_a_histogram_is_a_density_of_what_was_drawn():
    image = picture_of(np.random.default_rng(0).normal(0, 1, 200_000))
    middles, logs = log_histogram(image, bins=61, reach=4.0)
    along = 2 * np.exp(logs) * (middles[1] - middles[0])
    away = np.abs(middles) > 0.2  # The other half of the gradients are zeros.
    expected = stats.norm.pdf(middles) * (middles[1] - middles[0])
    close = away & (np.abs(middles) < 2)
    assert along[close] == pytest.approx(expected[close], rel=0.1)


def test_a_fit_finds_the_mixture_that_was_drawn():
    image = np.add.outer(drawn(MIXTURE, 400, 1).cumsum(), drawn(MIXTURE, 2_000, 2).cumsum())
    fit = fit_mixture(image, 2)
    truth = GaussianMixture(
        *zip(*sorted(zip(MIXTURE.shares, MIXTURE.deviations, strict=True)), strict=True)
    )
    assert sorted(fit.deviations) == pytest.approx(sorted(truth.deviations), rel=0.25)
    pairs = zip(fit.shares, fit.deviations, strict=True)
    assert sum(share * deviation**2 for share, deviation in pairs) == pytest.approx(
        np.mean(np.asarray(gradients(torch.from_numpy(image))) ** 2), rel=0.02
    )


def test_a_fit_finds_the_power_that_was_drawn():
    rng = np.random.default_rng(3)
    one, other = (stats.gennorm(0.7, scale=0.05).rvs(n, random_state=rng) for n in (400, 400))
    fit = fit_generalised_gaussian(np.add.outer(one.cumsum(), other.cumsum()))
    assert fit.power == pytest.approx(0.7, abs=0.1)


def test_photographs_have_heavy_tails_and_are_like_the_prior():
    values = gradients(torch.from_numpy(sharp())).ravel()
    assert 0.3 < fit_generalised_gaussian(sharp()).power < 0.9
    deviation = float(values.std())
    gaussian = GaussianMixture((1.0,), (deviation,)).log_density(values).mean()
    laplacian = -math.log(2 * float(values.abs().mean())) - 1
    natural = float(NATURAL_GRADIENTS.log_density(values).mean())
    assert natural > laplacian + 0.1
    assert natural > float(gaussian) + 0.3


def test_the_prior_is_nearly_the_likeliest_for_photographs():
    """As likely as one that is fitted to each, within what a fit of its own gains."""
    gains = []
    for picture in (data.camera(), data.astronaut().mean(2), data.chelsea().mean(2)):
        part = picture[:255, :255] / 255.0
        part = part * LIGHT_DEVIATION / part.std()
        values = gradients(torch.from_numpy(part)).ravel()
        fit = fit_mixture(part, 4)
        gains.append(
            float((fit.log_density(values) - NATURAL_GRADIENTS.log_density(values)).mean())
        )
    assert max(gains) < 0.6


def test_even_pictures_have_no_statistics():
    with pytest.raises(ValueError, match="same everywhere"):
        log_histogram(np.ones((8, 8)))
    with pytest.raises(ValueError, match="NaN"):
        fit_mixture(np.full((8, 8), np.nan))
    with pytest.raises(ValueError, match="components"):
        fit_mixture(sharp(), 0)
    with pytest.raises(ValueError, match="sum to 1"):
        GaussianMixture((0.5, 0.2), (1.0, 2.0))
