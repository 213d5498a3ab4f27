"""The published objective term by term against loops, its gradient against finite differences."""

import math

import numpy as np
import pytest
import torch
from scipy.signal import convolve2d

from optics.inverse import build_mosaic_observation
from optics.inverse.bounded import Misfit
from optics.multispectral import restore_by_published_objective
from optics.multispectral.published_restoration import PublishedObjective, _forward_operator
from optics.progress import Cancelled, Progress

BAYER = ("RG", "GB")
RESPONSE = np.array([[0.7, 0.2, 0.1, 0.0], [0.2, 0.6, 0.5, 0.2], [0.1, 0.2, 0.4, 0.8]])
WEIGHTS = {"smoothness": 0.03, "variation": 0.02, "cross_channel": 0.05}


def random(*shape, seed=0):
    return np.random.default_rng([seed, *shape]).random(shape)


def psfs(bands=4, rows=5, columns=3):
    kernels = random(bands, rows, columns, seed=1)
    return kernels / kernels.sum((1, 2), keepdims=True)


def mosaic(scene, kernels):
    """What the sensor sees of a scene that is dark around, pixel by pixel."""
    blurred = [convolve2d(band, psf, mode="same") for band, psf in zip(scene, kernels, strict=True)]
    raw = np.zeros(scene.shape[1:])
    for y, x in np.ndindex(*raw.shape):
        letter = "RGB".index(BAYER[y % 2][x % 2])
        raw[y, x] = sum(RESPONSE[letter, n] * blurred[n][y, x] for n in range(len(scene)))
    return raw


def observation(shape=(8, 7), border="dark", dtype=np.float64):
    kernels = psfs()
    raw = mosaic(random(4, *shape, seed=2), kernels).astype(dtype)
    return build_mosaic_observation(
        raw, BAYER, kernels, response=RESPONSE, noise=1e-3, border=border
    )


def objective(seen, smoothing=0.1, periodic=False, **weights):
    misfit = Misfit(_forward_operator(seen), seen.image)
    return PublishedObjective(misfit, **{**WEIGHTS, **weights}, smoothing=smoothing,
                              periodic=periodic)  # fmt: skip


def summed(x, raw, kernels, smoothing, smoothness, variation, cross_channel):
    """Eq. 4.3 to 4.6 as they stand there, in loops."""

    def absolute(t):
        return math.sqrt(t * t + smoothing * smoothing) - smoothing

    total = float(((mosaic(x, kernels) - raw) ** 2).sum())
    bands, rows, columns = x.shape
    for y, c in np.ndindex(rows, columns):
        for down, along in ((1, 0), (0, 1)):
            if y + down == rows or c + along == columns:
                continue
            here, step = x[:, y, c], x[:, y + down, c + along] - x[:, y, c]
            for n in range(bands):
                total += smoothness * step[n] ** 2 + variation * absolute(step[n])
                for i in range(bands):
                    if i != n:
                        total += cross_channel * absolute(step[n] * here[i] - step[i] * here[n])
    return total


@pytest.mark.parametrize("smoothing", [1e-3, 0.1])
def test_the_value_is_that_of_the_equations_in_loops(smoothing):
    seen, x = observation(), random(4, 8, 7, seed=3)
    value, _ = objective(seen, smoothing)(torch.from_numpy(x))
    raw = mosaic(random(4, 8, 7, seed=2), psfs())
    assert float(value) == pytest.approx(summed(x, raw, psfs(), smoothing, **WEIGHTS), rel=1e-10)


@pytest.mark.parametrize("border", ["dark", "unknown", "periodic"])
@pytest.mark.parametrize("kept", [*WEIGHTS, "all"])
def test_the_gradient_is_that_of_finite_differences(kept, border):
    """Of each term alone, and of all together: this is what the published program gets wrong."""
    others = {name: 0.0 for name in WEIGHTS if kept not in (name, "all")}
    seen = observation(border=border)
    function = objective(seen, 0.05, border == "periodic", **others)
    x = torch.from_numpy(random(*_forward_operator(seen).domain, seed=4))
    _, gradient = function(x)
    for seed in range(3):
        way, step = torch.from_numpy(random(*x.shape, seed=seed + 5) - 0.5), 1e-6
        rise = float(function(x + step * way)[0] - function(x - step * way)[0]) / (2 * step)
        assert rise == pytest.approx(float((gradient * way).sum()), rel=1e-6)


def test_single_precision_gives_the_same():
    x = torch.from_numpy(random(4, 8, 7, seed=6))
    value, gradient = objective(observation())(x)
    short, steep = objective(observation(dtype=np.float32))(x.float())
    assert float(short) == pytest.approx(float(value), rel=1e-5)
    assert steep.dtype == torch.float32
    assert steep.numpy() == pytest.approx(gradient.numpy(), abs=1e-4)


def test_scenes_of_one_hue_have_no_cross_channel_penalty():
    """Every band is a multiple of one picture: hue is constant along edges (Eq. 4.5)."""
    seen = observation()
    shades, picture = random(4, seed=7), random(8, 7, seed=8)
    one_hue = torch.from_numpy(shades[:, None, None] * picture)
    without, _ = objective(seen, cross_channel=0.0)(one_hue)
    assert float(objective(seen)(one_hue)[0]) == pytest.approx(float(without), rel=1e-12)


def test_turned_and_exchanged_scenes_have_the_same_penalty():
    """A transposed scene, and bands in another order; the data term left out."""
    seen = observation((8, 8))
    whole = objective(seen)
    bare = objective(seen, smoothness=0.0, variation=0.0, cross_channel=0.0)
    x = torch.from_numpy(random(4, 8, 8, seed=9))

    def penalty(scene):
        return float(whole(scene)[0] - bare(scene)[0])

    assert penalty(x.mT.contiguous()) == pytest.approx(penalty(x), rel=1e-10)
    assert penalty(x[[2, 0, 3, 1]]) == pytest.approx(penalty(x), rel=1e-10)


def squares_scene(side=32):
    """Squares of four bands whose spectra differ, dark around."""
    scene = np.zeros((4, side, side))
    for k, (y, x) in enumerate(((4, 4), (4, 18), (18, 4), (18, 18))):
        scene[:, y : y + 10, x : x + 10] = random(4, seed=20 + k)[:, None, None]
    return scene


def restored(raw, kernels, **options):
    seen = build_mosaic_observation(
        raw, BAYER, kernels, response=RESPONSE, noise=0.0, border="dark"
    )
    return restore_by_published_objective(seen, **options)


def test_a_restoration_comes_nearer_to_the_scene_and_keeps_within_its_bounds():
    scene, kernels = squares_scene(), psfs(4, 7, 7)
    raw = mosaic(scene, kernels)
    few, many = (restored(raw, kernels, iterations=n).image for n in (1, 60))
    errors = [np.sqrt(np.mean((image - scene) ** 2)) for image in (few, many)]
    assert errors[1] < 0.6 * errors[0]
    assert isinstance(many, np.ndarray)
    assert many.min() >= 0
    assert many.max() <= 1


def test_the_unit_of_light_doesnt_matter():
    scene, kernels = squares_scene(16), psfs(4, 5, 5)
    raw = mosaic(scene, kernels)
    plain = restored(raw, kernels, iterations=10)
    bright = restored(4000 * raw, kernels, iterations=10, white=4000.0)
    assert bright.image / 4000 == pytest.approx(plain.image, abs=1e-6)


def test_dead_pixels_dont_count():
    scene, kernels = squares_scene(16), psfs(4, 5, 5)
    raw = mosaic(scene, kernels)
    sound = np.ones_like(raw)
    sound[3, 5] = 0.0
    broken = raw.copy()
    broken[3, 5] = 9.0
    both = [
        restore_by_published_objective(
            build_mosaic_observation(
                one, BAYER, kernels, response=RESPONSE, noise=0.0, border="dark", weights=sound
            ),
            iterations=10,
        ).image
        for one in (raw, broken)
    ]
    assert both[0] == pytest.approx(both[1], abs=1e-9)


@pytest.mark.parametrize(
    ("argument", "value"),
    [("smoothness", -1.0), ("variation", math.nan), ("cross_channel", math.inf),
     ("smoothing", 0.0), ("white", -1.0), ("iterations", 0), ("tol", 0.0)],
)  # fmt: skip
def test_bad_arguments_are_named(argument, value):
    with pytest.raises(ValueError, match=argument):
        restore_by_published_objective(observation(), **{argument: value})


def test_a_single_band_is_refused():
    seen = build_mosaic_observation(np.ones((4, 4)), ("R",), channels="R")
    with pytest.raises(ValueError, match="one band"):
        restore_by_published_objective(seen)


def test_it_can_be_cancelled():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        restore_by_published_objective(observation(), progress=progress)
