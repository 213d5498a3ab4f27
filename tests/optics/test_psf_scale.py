"""The scale of a PSF that is a little too large or small, from the photograph's spectrum alone."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from scipy.signal import fftconvolve
from skimage import data
from sweeps import some

from labapp.accuracy.blurs import circle, disk, gaussian
from optics.inverse import build_observation, find_psf_scale, restore
from optics.inverse.verdict import refine_psf_scale, scaled_psf


@pytest.fixture(scope="module")
def scenes():
    pictures = data.camera(), data.astronaut().mean(-1), data.coffee().mean(-1)
    return [one[60:330, 90:390] / 255.0 for one in pictures]


def observe(scene, true, given, noise=0.004):
    frame = fftconvolve(scene, true, mode="valid")
    noisy = frame + np.random.default_rng(3).normal(0, noise, frame.shape)
    return build_observation(noisy, given)


@pytest.mark.parametrize("scale", [0.92, 1.0, 1.07])
@pytest.mark.parametrize("side", [40, 41])
def test_a_scaled_gaussian_is_a_gaussian_of_another_size(scale, side):
    def at(deviation, count):
        x = np.arange(count) - count // 2
        psf = np.exp(-(x[:, None] ** 2 + x**2) / (2 * deviation**2))
        return torch.from_numpy(psf / psf.sum())

    found = scaled_psf(0.7 * at(3.0, side), scale)
    assert float(found.sum()) == pytest.approx(0.7, rel=1e-12)
    expected = 0.7 * at(3.0 * scale, found.shape[0])
    assert float((found - expected).norm() / expected.norm()) < 2e-3


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan")])
def test_a_scale_that_isnt_positive_is_refused(scale):
    with pytest.raises(ValueError, match="scale is"):
        scaled_psf(torch.ones(3, 3), scale)


SHAPES = ((disk, 7.0), (lambda r: circle(r, 0.1), 12.0), (lambda r: circle(r, 0.0), 20.0))


@pytest.mark.parametrize(
    ("shape", "true", "number"),
    some(itertools.product(SHAPES, [0.95, 1.05], range(3)), 0, 4, 7, 9, 14, 15),
)
def test_a_wrong_scale_is_found_with_its_sign_and_size(scenes, shape, true, number):
    """The photographs are blurred by a PSF that is drawn anew in its true size."""
    drawn, size = shape
    found = find_psf_scale(observe(scenes[number], drawn(size * true), drawn(size)))
    assert found.is_wrong
    assert found.scale == pytest.approx(true, abs=0.015)


@pytest.mark.parametrize(
    ("psf", "number"),
    some(itertools.product([disk(4.0), circle(15.0, 0.1), gaussian(2.0)], range(3)), 0, 4, 8),
)
def test_a_right_scale_is_left_alone(scenes, psf, number):
    found = find_psf_scale(observe(scenes[number], psf, psf))
    assert not found.is_wrong
    assert found.evidence >= 0


def test_a_refined_psf_restores_as_well_as_the_right_one(scenes):
    true, given, scene = disk(6.6), disk(7.0), scenes[0]
    observation = observe(scene, true, given)
    refined = refine_psf_scale(observation, find_psf_scale(observation))
    rows, columns = observation.image.shape
    top, left = ((n - 1) - n // 2 for n in true.shape)
    truth = scene[top : top + rows, left : left + columns]

    def left_over(one):
        return float(np.sqrt(np.mean((np.asarray(restore(one).image) - truth) ** 2)))

    assert left_over(refined) < 1.06 * left_over(observe(scene, true, true))
    assert left_over(refined) < 0.9 * left_over(observation)


def test_without_structure_there_is_no_evidence():
    rng = np.random.default_rng(0)
    for image, psf in (
        (np.full((60, 60), 0.3), disk(3.0)),
        (rng.random((60, 60)), np.ones((1, 1))),
        (rng.random((5, 5)), np.ones((3, 3)) / 9),
    ):
        found = find_psf_scale(build_observation(image, psf))
        assert (found.scale, found.evidence, found.frequencies) == (1.0, 0.0, 0)
        assert not found.is_wrong
