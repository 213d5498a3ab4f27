"""Images of layers that hide each other, against a light field, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from judges.basics import natural_image
from judges.light_field import (
    CASES,
    LayeredCase,
    compare_compositors,
    lattice_shifts,
    light_field_image,
    pupil_points,
    shift_transfer,
    sum_of_masked_layers,
    textured_layers,
)

from optics.edof import layered_capture
from optics.edof.layered_capture import composite_layers, flatten_layers

SIDE = 96


def scene(layers: int = 2, seed: int = 4, rows: int = 12, columns: int = 10):
    rng = np.random.default_rng(seed)
    pictures = rng.uniform(0.1, 1, (layers, rows, columns))
    mattes = rng.uniform(0, 1, (layers, rows, columns))
    mattes[-1] = 1
    kernels = rng.uniform(0, 1, (layers, rows, columns))
    kernels *= (
        np.array([0.8, 0.9, 1.0, 0.7])[:layers, None, None] / kernels.sum((1, 2))[:, None, None]
    )
    return pictures, mattes, kernels, np.fft.rfft2(kernels)


def blurred(picture, kernel):
    """A periodic convolution, written as a sum of displaced pictures."""
    rows, columns = kernel.shape
    return sum(
        kernel[y, x] * np.roll(picture, (y, x), (0, 1)) for y in range(rows) for x in range(columns)
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_images_agree_with_a_light_field_and_masked_layers_do_not(case: LayeredCase):
    """Both of one scene; 36 dB is what the design asks of this formula."""
    found = compare_compositors(
        case, {"over": composite_layers, "masked": sum_of_masked_layers}, SIDE, 12.0, seed=2
    )
    assert found["over"] >= 36
    assert found["over"] >= found["masked"] + 6


def test_a_background_in_focus_is_exact():
    """The part of the pupil that sees it is the blurred matte, whatever the foreground."""
    points = pupil_points(9, 16)
    weights = np.full(len(points), 1 / len(points))
    pictures, mattes = textured_layers(64, 2, 5)
    shifts = np.stack([lattice_shifts(points, d, np.array([[0.5]]), 9.0) for d in (1.6, 0.5)])
    transfers = np.stack([shift_transfer(one, weights, (64, 64)) for one in shifts])
    truth = light_field_image(pictures, mattes, shifts, weights)
    np.testing.assert_allclose(composite_layers(pictures, mattes, transfers), truth, atol=1e-12)


def test_the_light_fields_transfer_is_that_of_its_own_image():
    """The judge of a single layer, by its shifts, against its transfer function."""
    points = pupil_points(5, 8)
    weights = np.full(len(points), 0.9 / len(points))
    picture = natural_image(24, 30, 1)
    shifts = lattice_shifts(points, 1.7, np.array([[0.2, 1.0]]), 5.0)
    image = light_field_image(picture[None], np.ones((1, 24, 30)), shifts[None], weights)
    transfer = shift_transfer(shifts, weights, (24, 30))
    expected = np.fft.irfft2(np.fft.rfft2(picture) * transfer, (24, 30))
    np.testing.assert_allclose(image, expected, atol=1e-12)


def test_three_layers_by_direct_sums():
    pictures, mattes, kernels, transfers = scene(3)
    image = np.zeros(pictures.shape[1:])
    seen = np.ones_like(image)
    for picture, matte, kernel in zip(pictures, mattes, kernels, strict=True):
        image += seen * blurred(matte * picture, kernel)
        seen = seen * (1 - blurred(matte, kernel / kernel.sum()))
    np.testing.assert_allclose(composite_layers(pictures, mattes, transfers), image, atol=1e-12)


def test_one_layer_is_a_blurred_plane():
    pictures, mattes, kernels, transfers = scene(1, columns=9)
    image = composite_layers(pictures, mattes, transfers)
    np.testing.assert_allclose(image, blurred(pictures[0], kernels[0]), atol=1e-12)


def test_a_full_layer_hides_all_though_its_psf_loses_light():
    pictures, mattes, kernels, transfers = scene(2)
    mattes[0] = 1
    image = composite_layers(pictures, mattes, transfers)
    np.testing.assert_allclose(image, blurred(pictures[0], kernels[0]), atol=1e-12)


def test_equal_layers_of_constant_light_show_no_edge():
    """Both lose a tenth of their light beyond the window."""
    _, mattes, kernels, _ = scene(2)
    transfers = np.fft.rfft2(0.9 * kernels / kernels.sum((1, 2))[:, None, None])
    image = composite_layers(np.ones(mattes.shape), mattes, transfers)
    np.testing.assert_allclose(image, 0.9, atol=1e-12)


def test_sharp_psfs_show_the_flat_picture():
    pictures, mattes, _, transfers = scene(4)
    sharp = composite_layers(pictures, mattes, np.ones_like(transfers))
    flat, seen = np.zeros(pictures.shape[1:]), np.ones(pictures.shape[1:])
    for picture, matte in zip(pictures, mattes, strict=True):
        flat, seen = flat + seen * matte * picture, seen * (1 - matte)
    np.testing.assert_allclose(flatten_layers(pictures, mattes), flat, atol=1e-12)
    np.testing.assert_allclose(sharp, flat, atol=1e-12)


def test_batches_are_scenes_side_by_side():
    scenes = [[torch.from_numpy(one) for one in scene(2, seed)] for seed in (1, 2)]
    pictures, mattes, _, transfers = (torch.stack(one) for one in zip(*scenes, strict=True))
    images = composite_layers(pictures, mattes, transfers)
    for image, (picture, matte, _, transfer) in zip(images, scenes, strict=True):
        torch.testing.assert_close(image, composite_layers(picture, matte, transfer))
    shared = composite_layers(pictures, mattes, transfers[0])
    expected = composite_layers(pictures[1], mattes[1], transfers[0])
    torch.testing.assert_close(shared[1], expected)


def test_derivatives_are_those_of_finite_differences():
    pictures, mattes, kernels, _ = (torch.from_numpy(one) for one in scene(3, rows=4, columns=5))

    def image(pictures, mattes, kernels):
        # The farthest matte stays 1.
        mattes = torch.cat((mattes, torch.ones_like(pictures[:1])))
        return composite_layers(pictures, mattes, torch.fft.rfft2(kernels))

    given = [one.clone().requires_grad_() for one in (pictures, mattes[:2] * 0.9 + 0.05, kernels)]
    assert torch.autograd.gradcheck(image, given)


@pytest.mark.parametrize(("layers", "expected"), [(1, 2), (2, 6), (3, 10)])
def test_two_layers_take_three_times_the_transforms_of_a_plane(layers, expected, monkeypatch):
    counted = []
    for name in ("rfft2", "irfft2"):
        transform = getattr(layered_capture, name)
        monkeypatch.setattr(
            layered_capture,
            name,
            lambda x, *shape, transform=transform: counted.append(x) or transform(x, *shape),
        )
    pictures, mattes, _, transfers = scene(layers)
    composite_layers(pictures, mattes, transfers)
    assert len(counted) == expected


def with_nan(pictures):
    pictures = pictures.copy()
    pictures[0, 0, 0] = np.nan
    return pictures


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p, m, h: (p[0], m[0], h[0]), "at least one layer"),
        (lambda p, m, h: (p[:0], m[:0], h[:0]), "at least one layer"),
        (lambda p, m, h: (p, m[:1], h), "mattes is"),
        (lambda p, m, h: (p, m[:, :-1], h), "mattes is"),
        (lambda p, m, h: (p, 1.1 * m, h), "from 0 to 1"),
        (lambda p, m, h: (p, m - 0.1, h), "from 0 to 1"),
        (lambda p, m, h: (p, with_nan(m), h), "mattes"),
        (lambda p, m, h: (with_nan(p), m, h), "pictures has 1 NaN"),
        (lambda p, m, h: (p, m[::-1].copy(), h), "farthest"),
        (lambda p, m, h: (p, m, h[:1]), "transfers is complex"),
        (lambda p, m, h: (p, m, h[..., :-1]), "transfers is complex"),
        (lambda p, m, h: (p, m, h.real.copy()), "transfers is real"),
        (lambda p, m, h: (p, m, 0 * h), "at zero frequency"),
        (lambda p, m, h: (p, m, -h), "at zero frequency"),
        (lambda p, m, h: (p, m, with_nan(h)), "transfers has"),
    ],
)
def test_bad_layers_are_refused(change, words):
    pictures, mattes, _, transfers = scene(2)
    composite_layers(pictures, mattes, transfers)
    with pytest.raises(ValueError, match=words):
        composite_layers(*change(pictures, mattes, transfers))


def test_bad_layers_are_refused_for_the_flat_picture():
    pictures, mattes, _, _ = scene(2)
    with pytest.raises(ValueError, match="from 0 to 1"):
        flatten_layers(pictures, 1.1 * mattes)
