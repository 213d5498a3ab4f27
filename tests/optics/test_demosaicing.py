"""Demosaicing by its parts written out, and of photographs beside OpenCV's."""

import itertools
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from figures.opencv_demosaicing import interpolate_bayer
from scipy.signal import fftconvolve
from skimage import data
from sweeps import some
from test_total_variation import disk

from optics.inverse import Blur, SpectralMosaic, build_mosaic_observation, demosaic
from optics.inverse.band_coupling import helmert_matrix
from optics.inverse.mosaics import _LUMINANCE, MosaicObservation
from optics.progress import Cancelled, Progress

BAYER = ("RG", "GB")
KODAK = Path(__file__).parents[3] / "shared/data/natural/kodak"


def colours(side: int = 96) -> np.ndarray:
    """A photograph averaged down, so that it has colour in every pixel."""
    small = cv2.resize(data.astronaut(), (256, 256), interpolation=cv2.INTER_AREA)
    return np.moveaxis(small[10 : 10 + side, 60 : 61 + side], -1, 0) / 255.0


def mosaic(scene, pattern, noise=0.0, channels="RGB", seed=0):
    """Pixel by pixel."""
    raw = np.empty(scene.shape[1:])
    for y in range(raw.shape[0]):
        for x in range(raw.shape[1]):
            letter = pattern[y % len(pattern)][x % len(pattern[0])]
            raw[y, x] = scene[channels.index(letter), y, x]
    return raw + np.random.default_rng(seed).normal(0, noise, raw.shape)


def demosaiced(raw, pattern, method="prior", *, weight=None, iterations=30, **known):
    if method != "prior":
        return interpolate_bayer(raw, pattern, method)
    progress = known.pop("progress", None)
    seen = build_mosaic_observation(raw, pattern, known.pop("psf", None), **known)
    return demosaic(seen, weight, iterations=iterations, progress=progress)


def psnr(image, truth, rim=4) -> float:
    inside = (..., slice(rim, -rim), slice(rim, -rim))
    error = np.clip(np.asarray(image), 0, 1)[inside] - truth[inside]
    return 10 * math.log10(1 / np.mean(error**2))


BAYER_PATTERNS = (("RG", "GB"), ("GR", "BG"), ("BG", "GR"), ("GB", "RG"))


@pytest.mark.parametrize(
    ("pattern", "noise"),
    some(itertools.product(BAYER_PATTERNS, [0.0, 0.01, 0.03]), 0, 4, 8, 10),
)
def test_the_prior_beats_opencv_for_each_bayer_pattern(pattern, noise):
    scene = colours()
    raw = mosaic(scene, pattern, noise)
    ours = psnr(demosaiced(raw, pattern), scene)
    for method in ("bilinear", "edge-aware", "vng"):
        theirs = psnr(demosaiced(raw, pattern, method), scene)
        assert theirs > 20
        assert ours > theirs + 1


@pytest.mark.parametrize("pattern", [
    ("RGB",),  # Stripes.
    ("GGRGGB", "GGBGGR", "BRGRBG", "GGBGGR", "GGRGGB", "RBGBRG"),  # Fujifilm's X-Trans.
])  # fmt: skip
def test_other_patterns_are_restored_as_well(pattern):
    scene = colours()
    restored = demosaiced(mosaic(scene, pattern, 0.005), pattern, noise=0.005)
    assert psnr(restored, scene) > 30


def test_bands_behind_overlapping_filters_are_unmixed():
    """Four filters of a 2 x 2 cell that each see all of three bands."""
    scene = colours()
    response = np.array([[0.9, 0.2, 0.0], [0.2, 0.8, 0.2], [0.0, 0.3, 0.7], [0.5, 0.5, 0.5]])
    through = np.tensordot(response, scene, 1)
    raw = mosaic(through, ("ab", "cd"), 0.003, "abcd")
    restored = demosaiced(raw, ("ab", "cd"), channels="abcd", response=response, noise=0.003)
    assert psnr(restored, scene) > 28


@pytest.mark.parametrize("each", [False, True])
def test_blur_is_undone_with_the_mosaic(each):
    """Blurred on a larger field than the solver's; the PSF of all bands, or one for each."""
    psf, scene = disk(1.5), colours(128)
    own = [np.pad(p, (5 - len(p)) // 2) for p in (disk(1.0), disk(1.5), disk(2.0))]
    kernels = own if each else [psf] * 3
    frame = np.stack([fftconvolve(b, k, "valid") for b, k in zip(scene, kernels, strict=True)])
    rim = kernels[0].shape[0] // 2
    truth = scene[:, rim:-rim, rim:-rim]
    raw = mosaic(frame, BAYER, 0.003)
    blurry = psnr(demosaiced(raw, BAYER, noise=0.003), truth)
    sharp = psnr(demosaiced(raw, BAYER, noise=0.003, psf=np.stack(own) if each else psf), truth)
    assert sharp > blurry + 1.5


def test_what_is_even_stays_even_and_noiseless_samples_stay():
    grey = np.full((21, 18), 0.37)
    assert demosaiced(grey, BAYER, noise=0.0) == pytest.approx(np.full((3, 21, 18), 0.37), abs=1e-5)
    scene = colours(64)
    raw = mosaic(scene, BAYER)
    restored = demosaiced(raw, BAYER, noise=0.0)
    again = mosaic(restored, BAYER)
    assert np.abs(again - raw).max() < 0.05
    assert math.sqrt(np.mean((again - raw) ** 2)) < 0.003


def test_units_of_light_and_single_precision_dont_matter():
    raw = mosaic(colours(48), BAYER, 0.01)
    plain = demosaiced(raw, BAYER, noise=0.01)
    bright = demosaiced(4000 * raw, BAYER, noise=40.0)
    assert bright / 4000 == pytest.approx(plain, abs=1e-6)
    single = demosaiced(raw.astype(np.float32), BAYER, noise=0.01)
    assert single.dtype == np.float32
    assert single == pytest.approx(plain, abs=1e-3)


def test_dead_and_clipped_pixels_are_told_by_the_others():
    scene = colours()
    raw = mosaic(scene, BAYER, 0.005)
    dead = np.random.default_rng(3).random(raw.shape) < 0.03
    broken = np.where(dead, 2.0, raw)
    whole = psnr(demosaiced(raw, BAYER, noise=0.005), scene)
    known = demosaiced(broken, BAYER, noise=0.005, weights=(~dead).astype(float))
    assert psnr(known, scene) > whole - 1.5
    full = raw > 0.8
    cut = np.minimum(raw, 0.8)
    restored = demosaiced(cut, BAYER, noise=0.005, clipped=full)
    assert np.isfinite(restored).all()
    # Where something was clipped, the light is at least that.
    assert np.quantile((mosaic(restored, BAYER) - 0.8)[full], 0.05) > -0.02


def second_differences(x):
    """Down, along and across both, of a periodic picture, written out."""
    along = x.roll(-1, -1) - x
    return torch.stack(
        [
            x.roll(-1, -2) - 2 * x + x.roll(1, -2),
            x.roll(-1, -1) - 2 * x + x.roll(1, -1),
            math.sqrt(2) * (along.roll(-1, -2) - along),
        ]
    )


@pytest.mark.parametrize("bands", [1, 2, 3, 8])
def test_directions_of_colour_are_orthonormal_and_brightness_is_the_first(bands):
    turned = helmert_matrix(bands)
    assert torch.allclose(turned @ turned.T, torch.eye(bands, dtype=torch.float64), atol=1e-12)
    assert torch.allclose(turned[0], torch.full((bands,), bands**-0.5, dtype=torch.float64))


@pytest.mark.parametrize("blurs", ["none", "one", "each"])
def test_splitting_ends_at_the_least_of_its_objective(blurs):
    """No small step from there, of many, leads lower; written out over the operators' matrices."""
    rng, shape = np.random.default_rng(5), (9, 8)
    filters = torch.from_numpy(rng.random((3, *shape)))
    psf = {
        "none": None,
        "one": torch.from_numpy(rng.random((3, 3))),
        "each": torch.from_numpy(rng.random((3, 3, 3))),
    }[blurs]
    if psf is not None:
        psf = psf / psf.sum((-2, -1), keepdim=True)
    raw, weight = torch.from_numpy(rng.random(shape)), 0.02
    psfs = torch.ones(1, 1, 1, dtype=torch.float64) if psf is None else psf.reshape(-1, 3, 3)
    problem = MosaicObservation(raw, psfs.mean(0), 0.1, "periodic", psfs=psfs, filters=filters)
    x = demosaic(problem, weight, iterations=500)
    point = torch.ones(1, 1, dtype=torch.float64)
    spread = Blur((point if psf is None else psf).expand(3, -1, -1), problem.period_shape)
    camera = SpectralMosaic(filters / problem.filter_gain)

    def objective(x):
        left = camera(problem.crop_to_frame(spread(x))) - raw / problem.filter_gain
        turned = torch.tensordot(helmert_matrix(3), x, 1)
        second = second_differences(turned).square().sum(0)
        bends = _LUMINANCE * second[0].sqrt() + second[1:].sum(0).sqrt()
        return float((left**2).sum() / 2 + weight * bends.sum())

    least = objective(x)
    for seed in range(20):
        way = torch.from_numpy(np.random.default_rng(seed).standard_normal(x.shape))
        for length in (1e-2, -1e-2, 3e-3):
            assert objective(x + length * way) > least
    assert objective(0.999 * x) > least - 1e-5 * abs(least)
    assert objective(1.001 * x) > least - 1e-5 * abs(least)


@pytest.mark.parametrize("noise", [0.003, 0.01, 0.03])
def test_noise_of_a_mosaic_is_estimated(noise):
    """Of even patches within a twentieth; of a photograph it is no less, and not twice as much."""
    rng = np.random.default_rng(6)
    patches = np.kron(rng.random((3, 4, 4)), np.ones((64, 64)))
    even = torch.from_numpy(mosaic(patches, BAYER, noise))
    assert build_mosaic_observation(even, BAYER).noise == pytest.approx(noise, rel=0.1)
    scene = np.moveaxis(data.astronaut(), -1, 0)[:, :256, :256] / 255.0
    found = build_mosaic_observation(mosaic(scene, BAYER, noise), BAYER).noise
    assert 0.9 * noise < found < 1.5 * noise + 0.004


@pytest.mark.shared
@pytest.mark.skipif(not KODAK.exists(), reason="no photographs beside the checkout")
def test_kodaks_lighthouse_fence():
    scene = np.moveaxis(cv2.imread(str(KODAK / "kodim07.png"))[..., ::-1], -1, 0) / 255.0
    scene = scene[:, 100:300, 200:400]
    raw = mosaic(scene, BAYER)
    ours = psnr(demosaiced(raw, BAYER), scene)
    assert ours > psnr(demosaiced(raw, BAYER, "vng"), scene) + 1


def test_it_can_be_cancelled():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        demosaiced(np.ones((8, 8)), BAYER, progress=progress)


@pytest.mark.parametrize("shape", [(2, 2), (3, 5), (8, 9), (17, 12)])
def test_small_and_odd_frames_stay_finite(shape):
    for raw in (np.zeros(shape), np.random.default_rng(7).random(shape) - 0.5):
        restored = demosaiced(raw, BAYER)
        assert restored.shape == (3, *shape)
        assert np.isfinite(restored).all()


RAW = np.full((8, 9), 0.5)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: demosaiced(RAW * math.nan, BAYER), "raw has 72 NaN"),
    (lambda: demosaiced(RAW[None], BAYER), r"raw is \(1, 8, 9\)"),
    (lambda: demosaiced(RAW, "RGGB"), "pattern is 'RGGB'; give rows"),
    (lambda: demosaiced(RAW, ("RG", "G")), "all as long"),
    (lambda: demosaiced(RAW, ()), "give rows"),
    (lambda: demosaiced(RAW, ("RG", "GW")), "pattern has W"),
    (lambda: demosaiced(RAW, ("RG", "GR")), "no trusted pixel sees band 2"),
    (lambda: demosaiced(RAW, BAYER, noise=-1.0), "noise is -1"),
    (lambda: demosaiced(RAW, BAYER, weight=0.0), "weight is 0"),
    (lambda: demosaiced(RAW, BAYER, iterations=0), "iterations is 0"),
    (lambda: demosaiced(RAW, BAYER, psf=np.zeros((3, 3))), "psf sums to 0"),
    (lambda: demosaiced(RAW, BAYER, psf=np.ones((2, 3, 3))), r"psf is \(2, 3, 3\)"),
    (lambda: demosaiced(RAW, BAYER, response=np.eye(2)), r"response is \(2, 2\)"),
    (lambda: demosaiced(RAW, BAYER, weights=np.ones((2, 2))), "weights is"),
    (lambda: demosaiced(RAW, BAYER, weights=-np.ones((8, 9))), "negative nowhere"),
    (lambda: demosaiced(RAW, BAYER, clipped=np.ones((8, 9), bool)), "every pixel is clipped"),
])  # fmt: skip
def test_what_doesnt_fit_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()
