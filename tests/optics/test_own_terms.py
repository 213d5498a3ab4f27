"""The unit of the light and the place of the PSF's origin change no restored detail."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.signal import fftconvolve
from skimage import data
from sweeps import some

from labapp.accuracy.blurs import disk
from labapp.pictures.networks import bundled_denoiser
from optics.inverse import (
    build_layered_observation,
    build_mosaic_observation,
    build_observation,
    demosaic,
    find_psf_scale,
    judge_restoration,
    restore,
    restore_within_bounds,
)
from optics.inverse.layered import restore_layers
from optics.inverse.method_names import RESTORATIONS
from optics.inverse.psf_origin import centroid_offset
from optics.inverse.restored_image import residual_map
from optics.inverse.richardson_lucy import richardson_lucy
from optics.inverse.separable import restore_separable
from optics.inverse.total_variation import total_variation
from optics.inverse.variance_gain import estimate_variance_gain
from optics.metrics import psnr

SIDE, NOISE = 72, 0.006
FAR = (2.0**-60, 2.0**60)
OTHERS = (1e-18, 3e17, 1e33)


@pytest.fixture(scope="module")
def scene():
    """A scene that is larger than the frame by a reach of 12 pixels."""
    return data.camera()[150 : 150 + SIDE + 24, 180 : 180 + SIDE + 24] / 255.0


@pytest.fixture(scope="module")
def frame(scene):
    """What a camera sees of it through a disk, by a direct convolution, with noise."""
    blurred = fftconvolve(scene, disk(4.0), mode="same")[12:-12, 12:-12]
    noise = np.random.default_rng(5).normal(0, NOISE, blurred.shape)
    return (blurred + noise).astype(np.float32)


def restored(frame, psf, method, unit=1.0, border="unknown", noise=None, **weights):
    told = None if noise is None else noise * unit
    seen = build_observation((frame * unit).astype(np.float32), psf, told, border, **weights)
    denoise = bundled_denoiser() if method == "plug-and-play" else None
    count = {"l-bfgs-b": 15, "plug-and-play": 2}.get(method)
    return seen, restore(seen, method=method, count=count, denoise=denoise)


@pytest.mark.parametrize("method", RESTORATIONS)
@pytest.mark.parametrize("unit", some(FAR))
def test_a_unit_that_is_a_power_of_two_changes_no_bit(frame, method, unit):
    clipped = frame >= np.quantile(frame, 0.99)
    seen, at_one = restored(frame, disk(4.0), method, noise=NOISE, clipped=clipped)
    words = judge_restoration(seen, at_one).findings
    seen, far = restored(frame, disk(4.0), method, unit, noise=NOISE, clipped=clipped)
    assert np.array_equal(far.image / np.float32(unit), at_one.image)
    assert far.residual == at_one.residual
    assert far.noise == at_one.noise * unit
    assert [one.cause for one in judge_restoration(seen, far).findings] == [
        one.cause for one in words
    ]
    left = residual_map(seen, far)
    assert torch.equal(left.isnan(), torch.from_numpy(clipped))


@pytest.mark.parametrize("method", RESTORATIONS)
@pytest.mark.parametrize("unit", some(OTHERS))
def test_another_unit_changes_nothing_that_counts(frame, scene, method, unit):
    truth = scene[12:-12, 12:-12]
    _, at_one = restored(frame, disk(4.0), method)
    _, far = restored(frame, disk(4.0), method, unit)
    now = psnr(far.image.astype(float) / unit, truth)
    assert now == pytest.approx(psnr(at_one.image, truth), abs=0.02)


def test_double_precision_goes_on_where_single_ends(frame):
    at_one = restore(build_observation(frame.astype(float), disk(4.0)))
    for unit in (2.0**-300, 2.0**300):
        far = restore(build_observation(frame.astype(float) * unit, disk(4.0)))
        assert np.array_equal(far.image / unit, at_one.image)


def test_a_told_weight_has_the_lights_unit(frame):
    for power in (1.0, 0.5):
        first = total_variation(build_observation(frame, disk(4.0)), 0.002, power=power)
        weight = 0.002 * FAR[0] ** (2 - power)
        seen = build_observation(frame * np.float32(FAR[0]), disk(4.0))
        far = total_variation(seen, weight, power=power)
        assert far.weight == pytest.approx(weight)
        assert torch.allclose(far.image / FAR[0], first.image, atol=1e-6)


def test_bounds_have_the_lights_unit_and_may_be_negative(frame):
    at_one, far = (
        restore_within_bounds(
            build_observation(frame * np.float32(unit), disk(4.0)),
            lower=-0.01 * unit, upper=torch.full(frame.shape, 0.6 * unit), iterations=10,
        ).image / unit
        for unit in (1.0, FAR[1])
    )  # fmt: skip
    assert torch.equal(at_one, far)
    assert float(at_one.max()) == pytest.approx(0.6)
    assert float(at_one.min()) == pytest.approx(-0.01)


def test_what_is_wrong_is_said_in_the_given_unit(frame):
    seen = build_observation(frame * np.float32(1e-18), disk(4.0))
    with pytest.raises(ValueError, match="weight is -2"):
        total_variation(seen, -2.0)


def test_light_beyond_the_largest_number_is_refused_in_words(frame):
    bright = frame.astype(float) * (3.3e38 / float(frame.max()))
    seen = build_observation(bright.astype(np.float32), disk(4.0))
    with pytest.raises(ValueError, match="largest number of its precision; divide"):
        total_variation(seen)


def test_derivatives_dont_depend_on_the_unit(frame):
    """The own unit is taken anew, so that nothing which was computed before loses them."""
    image = torch.from_numpy(frame[:24, :24] * np.float32(2.0**-40)).requires_grad_()
    seen = build_observation(image, disk(2.0))
    assert seen.noise > 0
    (slope,) = torch.autograd.grad(richardson_lucy(seen, 3).image.sum(), image)
    plain = torch.from_numpy(frame[:24, :24]).requires_grad_()
    found = richardson_lucy(build_observation(plain, disk(2.0)), 3).image.sum()
    (expected,) = torch.autograd.grad(found, plain)
    assert torch.allclose(slope, expected, rtol=1e-4, atol=1e-5)


def test_depths_axes_mosaics_and_variance_maps_know_no_unit_either(frame):
    unit = np.float32(FAR[0])
    psfs = np.stack([disk(2.0), disk(2.0)])
    layers = (np.arange(SIDE)[:, None] < SIDE // 2) * np.ones((SIDE, SIDE), dtype=int)
    separable = np.outer(np.hanning(7), np.hanning(5))
    separable /= separable.sum()
    variance = (0.004**2 + 4e-4 * frame.clip(0)).astype(float)

    def all_of(unit):
        image = frame * np.float32(unit)
        deep = build_layered_observation(torch.from_numpy(image), psfs, torch.from_numpy(layers))
        yield restore_layers(deep, iterations=3, cg_steps=3).image / unit
        yield restore_separable(build_observation(image, separable)).image / unit
        raw = build_mosaic_observation(image, ("RG", "GB"), disk(2.0))
        yield torch.from_numpy(restore(raw, count=3, method="total-variation").image) / unit
        yield torch.from_numpy(demosaic(raw, iterations=3)) / unit
        mapped = build_observation(torch.from_numpy(image), disk(4.0), variance=variance * unit**2)
        yield total_variation(mapped, iterations=3).image / unit
        gain = estimate_variance_gain(
            mapped,
            lambda one, weight: total_variation(one, weight, iterations=3),
            torch.Generator().manual_seed(1),
        )
        yield torch.tensor([gain.light, gain.logarithm])
        yield torch.tensor(find_psf_scale(build_observation(image, disk(4.0))).evidence)

    for at_one, far in zip(all_of(1.0), all_of(float(unit)), strict=True):
        assert torch.equal(at_one, far)


def moved(psf, down, along):
    """The PSF with its light off the middle of a larger array."""
    room = 2 * max(abs(down), abs(along))
    whole = np.pad(psf, room // 2)
    return np.roll(whole, (down, along), (0, 1))


@pytest.mark.parametrize("method", RESTORATIONS)
@pytest.mark.parametrize(("down", "along"), some([(0, -8), (5, 5), (-1, -1)]))
def test_a_psf_off_its_origin_only_moves_the_picture(frame, scene, method, down, along):
    """Both are judged where both frames lie, with no margin but the shift."""
    _, centred = restored(frame, disk(4.0), method)
    seen, off = restored(frame, moved(disk(4.0), down, along), method)
    assert centroid_offset(seen.psf) == pytest.approx((down, along), abs=1e-5)
    both = tuple(slice(max(0, s), min(SIDE, SIDE + s)) for s in (down, along))
    own = tuple(
        slice(one.start - s, one.stop - s) for one, s in zip(both, (down, along), strict=True)
    )
    truth = scene[12:-12, 12:-12][both]
    lost = psnr(centred.image[both], truth) - psnr(off.image[own], truth)
    assert lost <= 0.1
    assert off.residual == pytest.approx(centred.residual, abs=0.03)
    left = residual_map(seen, off)
    assert math.sqrt(float(left.square().mean())) == pytest.approx(off.residual, abs=0.02)


def test_a_dark_border_goes_with_the_photograph():
    """A scene that is lit up to the frame's edge, and dark beyond."""
    scene = np.zeros((SIDE + 40, SIDE + 40))
    scene[20:-20, 20:-20] = data.camera()[150 : 150 + SIDE, 180 : 180 + SIDE] / 255.0
    frame = fftconvolve(scene, disk(4.0), mode="same")[20:-20, 20:-20]
    frame = (frame + np.random.default_rng(3).normal(0, NOISE, frame.shape)).astype(np.float32)
    truth = scene[20:-20, 20:-20]
    for method in ("total-variation", "richardson-lucy", "l-bfgs-b"):
        _, centred = restored(frame, disk(4.0), method, border="dark")
        _, off = restored(frame, moved(disk(4.0), 6, 0), method, border="dark")
        lost = psnr(centred.image[6:], truth[6:]) - psnr(off.image[:-6], truth[6:])
        assert lost <= 0.1


def test_a_mosaic_is_restored_with_psfs_off_their_origin(frame):
    """One grey band behind four filters is plain deconvolution, which knows the answer."""
    seen = [
        build_mosaic_observation(frame, ("RG", "GB"), psf, response=np.ones((3, 1)), noise=NOISE)
        for psf in (disk(4.0), moved(disk(4.0), 6, -6))
    ]
    centred, off = (restore(one, method="total-variation").image for one in seen)
    assert psnr(off[:-6, 6:], centred[6:, :-6]) > 40


def test_a_measured_psfs_own_place_is_left_to_it():
    """Sound kernels have their centroid up to 3.5 pixels off their origin; an array that only has
    a dark line more than an odd one hasn't."""
    for down, along, offset in ((3, -3, (0, 0)), (5, -1, (5, -1)), (0, -4, (0, -4))):
        seen = build_observation(np.ones((9, 9)), moved(disk(2.0), down, along))
        assert seen.psf_offset == offset
    even = np.pad(disk(2.0), (0, 1))
    assert build_observation(np.ones((9, 9)), even).psf_offset == (-1, -1)
    assert build_observation(np.ones((9, 9)), even[:, :-1]).psf_offset == (-1, 0)
    assert build_observation(np.ones((9, 9)), np.roll(even, 1, (0, 1))).psf_offset == (0, 0)
