"""Several depths in one picture, blurred by sums over single pixels or on a larger field."""

import math

import numpy as np
import pytest
import torch
from judges import gaussian_psf, natural_image, relative
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve
from skimage import data

from optics.inverse import OccludingBlur, VaryingBlur, layer_weights
from optics.inverse.layered import (
    _LayerEquations,
    build_layered_observation,
    paste_layers,
    restore_layers,
)
from optics.inverse.noise import squared_frequencies
from optics.inverse.total_variation import total_variation
from optics.progress import Cancelled, Progress


def disk(radius: float, n: int = 15) -> np.ndarray:
    y, x = np.mgrid[:n, :n] - n // 2
    psf = np.clip(radius + 0.5 - np.hypot(y, x), 0, 1)
    return psf / psf.sum()


def comet(n: int = 5) -> np.ndarray:
    psf = np.random.default_rng(n).random((n, n)) ** 3
    return psf / psf.sum()


def gathered(x, psfs, layers):
    """Around the period, one sum over all scene pixels for each pixel of the picture."""
    rows, columns = x.shape
    picture = np.zeros_like(x)
    for y in range(rows):
        for c in range(columns):
            for v in range(rows):
                for u in range(columns):
                    psf = psfs[layers[v, u]]
                    half = [m // 2 for m in psf.shape]
                    j = (y - v + half[0] + rows) % rows
                    i = (c - u + half[1] + columns) % columns
                    if j < psf.shape[0] and i < psf.shape[1]:
                        picture[y, c] += psf[j, i] * x[v, u]
    return picture


def hiding(pictures, covers, psfs):
    """From the farthest on: each surface's light over what it lets past."""
    light = np.zeros_like(pictures[0])
    for picture, cover, psf in reversed(list(zip(pictures, covers, psfs, strict=True))):
        past = 1 - fftconvolve(cover, psf, mode="same")
        light = light * past + fftconvolve(cover * picture, psf, mode="same")
    return light


MARGIN = 24


@pytest.fixture(scope="module")
def scene():
    """A photograph before another one, seen on a larger field than the frame: truth, layers, and
    pictures where nearer ones hide and where light just adds."""
    side = 96 + 2 * MARGIN
    near = data.camera()[120 : 120 + side, 140 : 140 + side] / 255.0
    far = data.moon()[100 : 100 + side, 100 : 100 + side] / 255.0
    y, x = np.mgrid[:side, :side]
    cover = (np.hypot(y - 90, x - 60) < 34).astype(float)
    psfs = [disk(4.5), disk(1.2)]
    truth = cover * near + (1 - cover) * far
    pictures = {
        "hiding": hiding((near, far), (cover, np.ones_like(far)), psfs),
        "adding": sum(
            fftconvolve(w * truth, psf, mode="same")
            for w, psf in zip((cover, 1 - cover), psfs, strict=True)
        ),
    }
    rng = np.random.default_rng(5)
    noisy = {name: cut(one) + rng.normal(0, 0.01, (96, 96)) for name, one in pictures.items()}
    return cut(truth), cut(1 - cover).astype(int), psfs, noisy


def cut(whole: np.ndarray) -> np.ndarray:
    return whole[MARGIN:-MARGIN, MARGIN:-MARGIN]


def psnr(image, truth, where=None) -> float:
    error = (np.clip(np.asarray(image), 0, 1) - truth) ** 2
    return -10 * math.log10(np.mean(error if where is None else error[where]))


def edges(layers: np.ndarray) -> np.ndarray:
    near = gaussian_filter(layers.astype(float), 3)
    return (near > 0.02) & (near < 0.98)


def test_a_picture_by_layers_is_the_sum_over_single_pixels():
    layers = np.random.default_rng(0).integers(0, 3, (9, 11))
    psfs = [comet(3), comet(5), np.pad(comet(3), ((0, 2), (1, 1)))[:4]]
    stacked = np.zeros((3, 5, 5))
    for number, psf in enumerate(psfs):
        top, left = 2 - psf.shape[0] // 2, 2 - psf.shape[1] // 2
        stacked[number, top : top + psf.shape[0], left : left + psf.shape[1]] = psf
    x = natural_image(9, 11, 1)
    weights = layer_weights(torch.from_numpy(layers), 3).double()
    ours = VaryingBlur(torch.from_numpy(stacked), weights)(torch.from_numpy(x))
    assert relative(ours, gathered(x, psfs, layers)) <= 1e-12


def test_what_hides_lets_past_what_its_own_picture_leaves():
    """Far from the border, three surfaces by scipy, from the farthest on."""
    rng = np.random.default_rng(2)
    pictures = [natural_image(60, 60, k) for k in (3, 4, 5)]
    seen = np.zeros((3, 60, 60))
    layers = np.full((60, 60), 2)
    layers[20:45, 15:40] = 1
    layers[28:38, 25:50] = 0
    for k in range(3):
        seen[k] = layers == k
    covers = [seen[0], seen[0] + seen[1], np.ones((60, 60))]
    psfs = np.stack([gaussian_psf(7, s) for s in (1.5, 0.4, 1.0)])
    ours = OccludingBlur(psfs, seen)(np.stack(pictures) + 0 * rng.random())
    theirs = hiding(pictures, covers, psfs)
    assert relative(ours[8:-8, 8:-8], theirs[8:-8, 8:-8]) <= 1e-12


def test_the_adjoint_of_what_hides_is_its_transpose():
    rng = np.random.default_rng(6)
    seen = rng.random((2, 10, 13))
    seen /= seen.sum(0)
    blur = OccludingBlur(rng.random((2, 5, 4)), seen)
    x, y = rng.normal(size=(2, 10, 13)), rng.normal(size=(10, 13))
    assert (blur(x) * y).sum() == pytest.approx((x * blur.adjoint(y)).sum(), rel=1e-10)


def test_the_smooth_solution_is_that_of_dense_least_squares():
    """|H x - y|² + weight * frequency² |x|², every matrix written out."""
    shape, weight = (9, 8), 0.5
    layers = np.random.default_rng(1).integers(0, 2, shape)
    psfs, image = [comet(3), comet(5)], natural_image(*shape, 8)
    size = shape[0] * shape[1]
    points = np.eye(size).reshape(size, *shape)
    blur = np.stack([gathered(one, psfs, layers).ravel() for one in points], 1)
    f = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1]))
    rough = np.stack([np.fft.ifft2(np.fft.fft2(p) * f**2).real.ravel() for p in points], 1)
    truth = np.linalg.solve(blur.T @ blur + weight * rough, blur.T @ image.ravel())
    seen = build_layered_observation(image, psfs, layers, 0.01, "periodic")
    penalty = weight * squared_frequencies(shape)
    equations = _LayerEquations(seen, occlusion=False)
    start = torch.zeros(1, 9, 5, dtype=torch.complex128)
    found, *_ = equations.solve(equations.data_spectrum, penalty, start, 300)
    ours = torch.fft.irfft2(found, s=shape)[0]
    assert relative(ours, truth.reshape(shape)) <= 1e-4


def test_it_ends_where_no_change_lowers_the_objective():
    """The objective written out on the period, which quasi-Newton steps don't lower from there."""
    rng, shape, weight = np.random.default_rng(4), (16, 18), 0.02
    layers = np.zeros(shape, int)
    layers[:, 8:] = 1
    psfs = [comet(3), comet(5)]
    image = gathered(natural_image(*shape, 9), psfs, layers) + rng.normal(0, 0.01, shape)
    seen = build_layered_observation(image, psfs, layers, 0.01, "periodic")
    restored = restore_layers(seen, weight, occlusion=False, iterations=150, cg_steps=15)
    x = restored.period_image.clone().requires_grad_()
    blur = VaryingBlur(seen.psfs / seen.psf_sum, seen.period_shares)

    def objective(picture, smooth=0.0):
        down, along = (torch.roll(picture, -1, axis) - picture for axis in (0, 1))
        length = (down**2 + along**2 + smooth).sqrt().sum()
        return (blur(picture) - seen.normalised_image).square().sum() / 2 + weight * length

    found = float(objective(x.detach()))
    descent = torch.optim.LBFGS([x], max_iter=300, history_size=30, line_search_fn="strong_wolfe")

    def closure():
        descent.zero_grad()
        cost = objective(x, 1e-10)
        cost.backward()
        return cost

    descent.step(closure)
    assert found <= float(objective(x.detach())) * (1 + 1e-3)


@pytest.mark.parametrize("model", ["hiding", "adding"])
def test_together_they_are_better_than_pasted_above_all_at_edges(scene, model):
    truth, layers, psfs, noisy = scene
    seen = build_layered_observation(noisy[model], psfs, layers)
    assert seen.noise == pytest.approx(0.01, rel=0.2)
    ours = restore_layers(seen, occlusion=model == "hiding").image
    parts = paste_layers(seen, total_variation)
    at = edges(layers)
    assert psnr(ours, truth) > psnr(noisy[model], truth) + 2
    assert psnr(ours, truth) > psnr(parts, truth) + 0.5
    assert psnr(ours, truth, at) > psnr(parts, truth, at) + 1


def test_a_model_that_hides_is_worth_it_where_things_do(scene):
    truth, layers, psfs, noisy = scene
    seen, at = build_layered_observation(noisy["hiding"], psfs, layers), edges(layers)
    with_it, without = (restore_layers(seen, occlusion=one).image for one in (True, False))
    assert psnr(with_it, truth, at) > psnr(without, truth, at) + 3


def test_one_depth_alone_is_plain_total_variation(scene):
    psfs = scene[2]
    frame = fftconvolve(natural_image(120, 120, 3), psfs[0], mode="valid")
    frame = frame + np.random.default_rng(1).normal(0, 0.01, frame.shape)
    seen = build_layered_observation(frame, psfs[:1], np.zeros(frame.shape, int), 0.01)
    ours = restore_layers(seen, 2e-3, occlusion=False, iterations=100, cg_steps=10).image
    theirs = total_variation(seen.as_single_layer(0), 2e-3, iterations=300).image
    assert relative(ours, theirs) <= 5e-3


def test_a_weight_is_found_near_the_best(scene):
    truth, layers, psfs, noisy = scene
    seen = build_layered_observation(noisy["hiding"], psfs, layers)
    own = restore_layers(seen)
    best = max(psnr(restore_layers(seen, own.weight * 2.0**k).image, truth) for k in (-2, 2))
    assert psnr(own.image, truth) > best - 0.5


def test_clipped_and_dead_pixels_are_filled(scene):
    truth, layers, psfs, noisy = scene
    dead = np.random.default_rng(3).random((96, 96)) < 0.03
    clipped = noisy["hiding"] > 0.8
    broken = np.where(dead, 7.0, np.minimum(noisy["hiding"], 0.8))
    weights = (~dead).astype(np.float64)
    known = restore_layers(
        build_layered_observation(broken, psfs, layers, weights=weights, clipped=clipped & ~dead)
    ).image
    whole = restore_layers(build_layered_observation(noisy["hiding"], psfs, layers)).image
    assert psnr(known, truth) > psnr(whole, truth) - 2
    assert float(known.max()) > 0.8


def test_soft_layers_are_taken_as_shares(scene):
    _, layers, psfs, noisy = scene
    shares = np.stack([layers == 0, layers == 1]).astype(float)
    hard, soft = (
        restore_layers(
            build_layered_observation(noisy["hiding"], psfs, one), 1e-3, iterations=3
        ).image
        for one in (layers, shares)
    )
    assert np.array_equal(hard, soft)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("border", ["unknown", "dark", "periodic"])
def test_borders_precision_and_even_pictures(dtype, border):
    layers = np.zeros((21, 24), int)
    layers[5:15, 8:] = 1
    image = np.full((21, 24), 3.0, dtype)
    found = restore_layers(
        build_layered_observation(image, [comet(4), comet(5)], layers, 0.01, border), iterations=5
    )
    assert found.image.numpy().dtype == dtype
    assert bool(torch.isfinite(found.image).all())
    if border == "periodic":
        assert np.allclose(found.image, 3.0, rtol=2e-2)


def test_progress_is_reported_and_cancelling_stops():
    seen = build_layered_observation(np.ones((8, 8)), [comet(3)], np.zeros((8, 8), int), 0.1)
    heard = []
    restore_layers(seen, iterations=2, progress=Progress(lambda f, m: heard.append((f, m))))
    assert heard == [(0.0, "depths 1/2"), (0.5, "depths 2/2")]
    stopped = Progress()
    stopped.cancel()
    with pytest.raises(Cancelled):
        restore_layers(seen, progress=stopped)


def test_bad_arguments_are_refused_by_name():
    image, layers, psfs = np.ones((8, 9)), np.zeros((8, 9), int), [comet(3), comet(3)]
    with pytest.raises(ValueError, match=r"layers are \(9, 8\); with 2 PSFs"):
        build_layered_observation(image, psfs, layers.T)
    with pytest.raises(ValueError, match=r"layers go from 0 to 2"):
        build_layered_observation(image, psfs, layers + 2 * np.eye(8, 9, dtype=int))
    with pytest.raises(ValueError, match=r"layers miss 1 by 0.5"):
        build_layered_observation(image, psfs, np.full((2, 8, 9), 0.75))
    with pytest.raises(ValueError, match=r"psf sums to 0"):
        build_layered_observation(image, [comet(3), 0 * comet(3)], layers)
    with pytest.raises(ValueError, match=r"psfs must be one or more"):
        build_layered_observation(image, [], layers)
    seen = build_layered_observation(image, psfs, layers)
    with pytest.raises(ValueError, match=r"weight is -1; it must be positive"):
        restore_layers(seen, -1.0)
    with pytest.raises(ValueError, match=r"cg_steps is 0; at least 1"):
        restore_layers(seen, cg_steps=0)
    with pytest.raises(ValueError, match=r"as many of both"):
        OccludingBlur(np.ones((2, 3, 3)), np.ones((3, 4, 4)))
