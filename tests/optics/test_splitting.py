"""Restoration by splitting of several bands: its laws as a whole, its minimum, its derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from scipy.signal import fftconvolve
from sweeps import some
from test_demosaicing import colours, mosaic, psnr
from test_plug_and_play import chambolle
from test_total_variation import disk

from optics.inverse import (
    Blur,
    CentredCrop,
    SpectralMosaic,
    build_mosaic_observation,
    build_observation,
    demosaic,
    judge_restoration,
    restore,
)
from optics.inverse.band_coupling import BandCoupling, helmert_matrix
from optics.inverse.normal_equations import NormalEquations
from optics.inverse.restored_image import residual_map
from optics.inverse.total_variation import total_variation

BAYER = ("RG", "GB")
SIZES = [(8, 8), (9, 7), (7, 12)]


def numbers(*shape, seed=0):
    return torch.from_numpy(np.random.default_rng([seed, *shape]).random(shape))


def spreads(bands, *shape, seed=1):
    psfs = numbers(bands, *shape, seed=seed) + 0.2
    return psfs / psfs.sum((-2, -1), keepdim=True)


def problem(shape, bands=3, border="unknown", seed=2, **known):
    """A Bayer mosaic that sees so many bands through overlapping filters."""
    response = numbers(3, bands, seed=seed) + torch.eye(3, bands).double()
    return build_mosaic_observation(
        numbers(*shape, seed=seed), BAYER, spreads(bands, 3, 4), response=response, noise=0.02,
        border=border, **known,
    )  # fmt: skip


def camera(seen):
    """The chain of operators, written out: blur, crop to the frame, filters."""
    light = (seen.filters * seen.filters).sum(0).mean().sqrt()
    blur = Blur(seen.psfs / seen.psf.sum(), seen.period_shape)
    crop = CentredCrop(seen.period_shape, seen.image.shape, (seen.bands,))
    return SpectralMosaic(seen.filters / light) @ crop @ blur


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("border", ["unknown", "dark"])
def test_the_problem_is_the_chain_of_its_operators(shape, border):
    """Linear, with the right adjoint, and as one dense matrix; missing pixels included."""
    trust = (numbers(*shape, seed=4) > 0.2).double()
    seen = problem(shape, border=border, weights=trust)
    chain = camera(seen)
    x, y = numbers(*chain.domain, seed=5), numbers(*chain.domain, seed=6)

    def frame(picture):
        light = torch.fft.irfft2(torch.fft.rfft2(picture) * seen.otf, s=seen.period_shape)
        return seen.sum_bands(seen.crop_to_frame(light))[0]

    assert torch.allclose(frame(x), chain(x))
    assert torch.allclose(frame(2 * x - 3 * y), 2 * frame(x) - 3 * frame(y))
    equations = NormalEquations(seen, keeps_mean=True)
    back = torch.fft.irfft2(equations.data_spectrum, s=seen.period_shape)
    assert torch.allclose(back, chain.adjoint(trust * seen.normalised_image))
    size = math.prod(chain.domain)
    unit = torch.eye(size).double().reshape(size, *chain.domain)
    matrix = chain(unit).reshape(size, -1).T
    dense = matrix.T @ (trust.reshape(-1, 1) * matrix)
    twice = equations.apply_data_gram(torch.fft.rfft2(x))
    twice = torch.fft.irfft2(twice, s=seen.period_shape)
    assert torch.allclose(twice.flatten(), dense @ x.flatten(), atol=1e-6)


SPECTRA = np.array([[1.0, 0.9, 0.7], [0.2, 0.5, 0.9], [0.6, 0.6, 0.5], [0.9, 0.3, 0.1]])

COUPLINGS = {
    "separate": BandCoupling.separate(3),
    "vector": BandCoupling(torch.ones(3).double(), (3,)),
    "luminance": BandCoupling.luminance_chrominance(3, 0.4),
    "spectral": BandCoupling.spectral(torch.from_numpy(SPECTRA)),
    "more bands than channels": BandCoupling.spectral(numbers(9, 5, seed=13)),
}


def objective(seen, bands, weight, x):
    """Half the squared misfit, and the joint lengths of each group, written out."""
    axes = torch.eye(bands.bands).double() if bands.axes is None else bands.axes
    factors = bands.weights if bands.scales is None else bands.weights * bands.scales
    components = torch.tensordot(axes, x, 1) * factors[:, None, None]
    squares = (components.roll(-1, 1) - components) ** 2 + (
        components.roll(-1, 2) - components
    ) ** 2
    parts, first = [], 0
    for count in bands.groups:
        parts.append(squares[first : first + count].sum(0).sqrt().sum())
        first += count
    left = camera(seen)(x) - seen.normalised_image
    trust = 1.0 if seen.weights is None else seen.weights
    return float((trust * left**2).sum() / 2 + weight * sum(parts))


@pytest.mark.parametrize("name", some(COUPLINGS, 2, 4))
@pytest.mark.parametrize("positive", [False, True])
def test_no_small_step_leads_below_the_solution(name, positive):
    bands, weight = COUPLINGS[name], 0.03
    seen = problem((9, 8), bands.bands, weights=(numbers(9, 8, seed=4) > 0.2).double())
    found = total_variation(seen, weight, bands=bands, iterations=400, tol=1e-10, positive=positive)
    x = found.period_image.clamp(min=0) if positive else found.period_image
    least = objective(seen, bands, weight, x)
    for seed in range(20):
        way = numbers(*x.shape, seed=seed + 20) - 0.5
        for length in (1e-2, -1e-2, 1e-3):
            other = x + length * way
            assert objective(seen, bands, weight, other.clamp(min=0) if positive else other) > least
    for factor in (0.999, 1.001):
        assert objective(seen, bands, weight, factor * x) > least - 1e-5 * least


@pytest.mark.parametrize("power", [1.0, 0.6])
@pytest.mark.parametrize("weights", [(1.0, 1.0), (0.5, 0.5)])
def test_the_shrinkage_of_a_group_is_the_minimum_that_a_search_finds(weights, power):
    """Of |W v|^p + 1 / (2 t) |v - a|²; for p below 1 the formula is Chartrand's, near it."""
    own = torch.tensor(weights).double()
    threshold = 0.3
    coupling = BandCoupling(own, (2,))
    values = torch.tensor([[2.0, 0.6, 0.05, 0.0], [1.0, -0.9, 0.08, 0.4]]).double()
    removed = coupling.removed_share(values[:, None].square(), threshold, power)
    split = (values[:, None] * (1 - removed))[:, 0]
    if power < 1:
        length = values.norm(dim=0)
        share = (own[0] ** power * (threshold / length) ** (2 - power)).clamp(max=1)
        assert torch.allclose(split, values * (1 - share))
        return
    for k in range(values.shape[1]):
        a = values[:, k].numpy()

        def cost(v, a=a):
            return np.linalg.norm(own.numpy() * v) + ((v - a) ** 2).sum() / (2 * threshold)

        best = min(
            (minimize(cost, start, method="Nelder-Mead", tol=1e-10) for start in (a, 0.01 * a)),
            key=lambda found: found.fun,
        )
        assert cost(split[:, k].numpy()) <= best.fun + 1e-9


@pytest.mark.parametrize("shape", SIZES)
def test_single_precision_agrees_with_double(shape):
    double = total_variation(problem(shape), 0.02, iterations=60)
    seen = build_mosaic_observation(
        numbers(*shape, seed=2).float(), BAYER, spreads(3, 3, 4),
        response=numbers(3, 3, seed=2) + torch.eye(3).double(), noise=0.02,
    )  # fmt: skip
    single = total_variation(seen, 0.02, iterations=60)
    assert single.image.dtype == torch.float32
    assert torch.allclose(single.image.double(), double.image, atol=2e-4)


def test_each_kind_of_unknown_has_the_right_derivative():
    """Along random directions, against differences of the solution: each alone in grey, and all at
    once through filters."""
    image, trust = numbers(8, 9, seed=2), 0.5 + numbers(8, 9, seed=3)
    response = numbers(3, 3, seed=2) + torch.eye(3).double()

    def restored(image, psfs, weight, trust):
        # Converged to some 1e-5, as a difference needs it.
        if len(psfs) == 1:
            seen, iterations = build_observation(image, psfs[0], 0.02, weights=trust), 550
        else:
            iterations, seen = 300, build_mosaic_observation(
                image, BAYER, psfs, response=response, noise=0.02, weights=trust
            )  # fmt: skip
        return total_variation(seen, weight, iterations=iterations, positive=True).image

    for psfs, weight in ((spreads(1, 3, 3), 0.02), (spreads(3, 3, 3), 0.05)):
        given = [image, psfs, torch.tensor(weight).double(), trust]
        recorded = [one.clone().requires_grad_() for one in given]
        seen = restored(*recorded)
        pull = numbers(*seen.shape, seed=9) - 0.5
        gradients = torch.autograd.grad((seen * pull).sum(), recorded)
        ways = [(numbers(*v.shape, seed=10 + k) - 0.3) * 1e-5 for k, v in enumerate(given)]
        kinds = [(k,) for k in range(4)] if len(psfs) == 1 else [(0, 1, 2, 3)]
        for moved in kinds:
            ends = [
                restored(*(v + sign * ways[k] * (k in moved) for k, v in enumerate(given))) * pull
                for sign in (1, -1)
            ]
            slope = sum(float((gradients[k] * ways[k]).sum()) for k in moved)
            difference = float((ends[0] - ends[1]).sum()) / 2
            assert slope == pytest.approx(difference, rel=1e-3)


def test_more_bands_than_channels_have_the_right_derivative():
    """By weight and trust at once, where the iterations have converged to some thousandths."""
    image, pull = numbers(6, 6, seed=2), numbers(5, 6, 6, seed=9) - 0.5

    def pulled(weight, trust):
        seen = build_mosaic_observation(
            image, BAYER, spreads(5, 3, 3), response=numbers(3, 5, seed=2), noise=0.02,
            weights=trust,
        )  # fmt: skip
        bands = COUPLINGS["more bands than channels"]
        found = total_variation(seen, weight, bands=bands, iterations=450, positive=True)
        return (found.image * pull).sum()

    given = [torch.tensor(0.03).double(), 0.5 + numbers(6, 6, seed=3)]
    ways = [torch.tensor(3e-5).double(), (numbers(6, 6, seed=10) - 0.3) * 1e-4]
    gradients = torch.autograd.grad(pulled(*(one.requires_grad_() for one in given)), given)
    with torch.no_grad():
        ends = [
            pulled(*(v + sign * way for v, way in zip(given, ways, strict=True)))
            for sign in (1, -1)
        ]
        slope = sum(float((g * way).sum()) for g, way in zip(gradients, ways, strict=True))
        assert slope == pytest.approx(float(ends[0] - ends[1]) / 2, rel=1e-2)


@pytest.mark.parametrize("bands", [2, 3, 5])
def test_channels_mix_to_what_the_sensor_measures(bands):
    """Of each band's light, and with a gain of its own that the picture's scale doesn't show."""
    seen = problem((9, 7), bands)
    channels, mixing = seen.channels
    assert mixing.shape == (min(bands, 3), bands)
    light = numbers(bands, 9, 7, seed=11)
    mixed = torch.tensordot(mixing, light, 1)
    assert torch.allclose(channels.sum_bands(mixed), seen.sum_bands(light))
    assert torch.allclose(channels.normalised_image, seen.normalised_image)
    assert channels.scene_noise == pytest.approx(seen.scene_noise)


def test_filters_that_differ_everywhere_make_a_channel_of_each_band():
    seen = problem((9, 8), 5)
    uneven = replace(seen, filters=seen.filters * (0.5 + numbers(5, 9, 8, seed=12)))
    channels, mixing = uneven.channels
    assert channels is uneven
    assert torch.equal(mixing, torch.eye(5).double())


def test_light_stays_within_an_upper_bound_that_it_would_exceed():
    seen = problem((9, 8))
    free = total_variation(seen, 1e-3, iterations=300, positive=True).image
    held = total_variation(seen, 1e-3, iterations=300, upper=0.6).image
    assert float(free.max()) > 0.7
    assert 0 <= float(held.min()) < float(held.max()) <= 0.6
    with pytest.raises(ValueError, match="upper is 0"):
        total_variation(seen, 1e-3, upper=0.0)


def test_a_coupling_of_other_bands_is_refused():
    with pytest.raises(ValueError, match="bands couples 2; the scene has 3"):
        total_variation(problem((8, 8)), 0.02, bands=BandCoupling.separate(2))


def test_what_has_no_derivative_is_refused():
    seen = build_observation(numbers(8, 8).requires_grad_(), spreads(1, 3, 3)[0], 0.02)
    with pytest.raises(ValueError, match="has no derivatives"):
        total_variation(seen, 0.02, power=0.7)


def colour_photograph(noise=0.005):
    """Blurred on a larger field than the solver's, a ring for each colour; and the sharp one."""
    scene, kernels = colours(128), []
    y, x = np.mgrid[-9:10, -9:10]
    for radius in (7.0, 6.0, 5.0):
        kernel = np.exp(-((np.hypot(y, x) - radius) ** 2) / 2) + 0.2 * disk(2.0).sum() * (
            y**2 + x**2 == 0
        )
        kernels.append(kernel / kernel.sum())
    frame = np.stack([fftconvolve(b, k, "valid") for b, k in zip(scene, kernels, strict=True)])
    return mosaic(frame, BAYER, noise).astype(np.float32), np.stack(kernels), scene[:, 9:-9, 9:-9]


def test_bands_restored_together_are_better_than_one_after_the_other():
    raw, psfs, scene = colour_photograph()
    seen = build_mosaic_observation(raw, BAYER, psfs)
    together = restore(seen)
    assert isinstance(together.image, np.ndarray)
    assert together.noise == pytest.approx(0.005, rel=0.3)
    bands = demosaic(build_mosaic_observation(raw, BAYER))
    apart = [restore(build_observation(b, k)).image for b, k in zip(bands, psfs, strict=True)]
    assert psnr(together.image, scene) > psnr(np.stack(apart), scene) + 0.5
    assert psnr(together.image, scene) > psnr(bands, scene) + 3
    left = residual_map(seen, together)
    assert left.shape == raw.shape
    assert float(left.square().mean()) ** 0.5 == pytest.approx(together.residual, rel=0.05)
    verdict = judge_restoration(seen, together)
    assert not verdict.is_good
    assert "a wrong PSF doesn't show" in str(verdict)
    assert not verdict.findings


def test_plug_and_play_restores_bands_on_axes_of_luminance_and_colour():
    raw, psfs, scene = colour_photograph()
    heard = []

    def denoise(picture, noise, axes=None):
        heard.append((tuple(picture.shape), axes))
        turned = torch.tensordot(axes, picture, 1)
        return torch.tensordot(axes.mT, chambolle(turned, noise), 1)

    seen = build_mosaic_observation(raw, BAYER, psfs)
    found = restore(seen, method="plug-and-play", denoise=denoise)
    assert (
        psnr(found.image, scene) > psnr(demosaic(build_mosaic_observation(raw, BAYER)), scene) + 3
    )
    assert heard[0][0] == (3, *seen.period_shape)
    assert torch.allclose(heard[0][1].double(), helmert_matrix(3), atol=1e-6)


def test_one_band_through_filters_is_restored_from_all_pixels():
    """Light of one colour, of which the filters let different shares through."""
    scene, psf = colours(96)[0], disk(3.0)
    frame = fftconvolve(scene, psf, "valid")
    response = np.array([[1.0], [0.2], [0.05]])
    raw = mosaic(np.stack([r * frame for r in response[:, 0]]), BAYER, 0.002)
    found = restore(build_mosaic_observation(raw, BAYER, psf, response=response))
    rim = psf.shape[0] // 2
    truth = scene[rim:-rim, rim:-rim]
    assert found.image.shape == truth.shape
    assert psnr(found.image, truth) > psnr(frame, truth) + 2


@pytest.mark.parametrize("method", ["wiener", "richardson-lucy", "hyper-laplacian", "l-bfgs-b"])
def test_methods_that_know_no_filters_say_so(method):
    with pytest.raises(ValueError, match="knows no colour filters; take total-variation or plug"):
        restore(problem((8, 8)), method=method)


@pytest.mark.parametrize(("spectra", "words"), [
    (np.zeros((4, 3)), "aren't all 0"),
    (np.ones(3), r"\(samples, bands\)"),
    (np.ones((2, 3)), "give 3 or more"),
    (np.full((4, 3), np.nan), "spectra has"),
])  # fmt: skip
def test_spectra_that_tell_nothing_are_refused(spectra, words):
    with pytest.raises(ValueError, match=words):
        BandCoupling.spectral(torch.from_numpy(spectra))


@pytest.mark.parametrize("bands", [1, 2, 3, 8])
def test_couplings_have_orthonormal_axes_and_a_mean_scale(bands):
    spectra = numbers(bands + 3, bands, seed=7)
    spectral = BandCoupling.spectral(spectra)
    unit = torch.eye(bands).double()
    assert torch.allclose(spectral.axes @ spectral.axes.T, unit, atol=1e-12)
    assert float(spectral.scales.log().mean()) == pytest.approx(0, abs=1e-9)
    x, y = numbers(bands, 4, 5), numbers(bands, 4, 5, seed=8)
    for one in (spectral, BandCoupling.luminance_chrominance(bands, 0.5)):
        product = float((one.components(x) * y).sum())
        assert float((x * one.components_adjoint(y)).sum()) == pytest.approx(product)
    # What is rarer among the spectra has a larger scale.
    spread = spectral.axes @ spectra.T
    assert bool((spread.square().sum(1).diff() <= 1e-9).all())
    assert bool((spectral.scales.diff() >= 0).all())


def test_weights_that_differ_within_a_group_are_refused():
    with pytest.raises(ValueError, match="weights of a group are"):
        BandCoupling(torch.tensor([1.0, 2.0, 2.0]).double(), (2, 1))
