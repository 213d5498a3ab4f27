"""Verdicts on restorations: what is right is called good, and what is wrong is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import fftconvolve
from skimage import data
from sweeps import some
from test_model_error import capture, disturb, photographs, shake

from labapp.accuracy.blurs import disk
from optics.inverse import build_observation, find_psf_scale, judge_restoration, restore
from optics.inverse.restored_image import residual_map

NOISE = 0.006

each_photograph = pytest.mark.parametrize("number", some(range(3)))


@pytest.fixture(scope="module")
def frames():
    """Photographs through a disk of 5, with noise."""
    rng, found = np.random.default_rng(8), []
    for picture in (data.camera(), data.astronaut().mean(-1), data.coffee().mean(-1)):
        frame = fftconvolve(picture[60:310, 90:350] / 255.0, disk(5.0), mode="valid")
        found.append(frame + rng.normal(0, NOISE, frame.shape))
    return found


def causes(frame, psf, noise=None, method=None, count=None):
    seen = build_observation(frame, psf, noise)
    restored = restore(seen, method=method, count=count)
    verdict = judge_restoration(seen, restored, find_psf_scale(seen))
    assert str(verdict).startswith("good") == verdict.is_good
    return [one.cause for one in verdict.findings]


@pytest.mark.parametrize("noise", [None, NOISE])
@pytest.mark.parametrize("method", ["total-variation", "wiener", "richardson-lucy"])
@each_photograph
def test_what_is_right_is_called_good(frames, noise, method, number):
    assert causes(frames[number], disk(5.0), noise, method) == []


@each_photograph
def test_what_was_told_wrongly_is_named(frames, number):
    frame = frames[number]
    assert causes(frame, disk(5.0), 3 * NOISE) == ["noise"]
    assert causes(frame, disk(5.0), NOISE / 3) == ["noise"]
    assert causes(frame, disk(5.0), 0.0) == ["noise"]
    assert causes(frame, disk(5.25))[0] == "psf-scale"
    assert causes(frame.clip(max=np.quantile(frame, 0.97)), disk(5.0))[0] == "clipping"


@each_photograph
def test_a_wrong_shape_is_named_as_the_psfs_error(number):
    _, frame = capture(photographs()[number], shake(number), 0.0015)
    assert "psf" in causes(frame, disturb(shake(number), 0.6, number))


def test_few_iterations_are_named(frames):
    assert causes(frames[0], disk(5.0), NOISE, "richardson-lucy", 2) == ["iterations"]


@pytest.mark.parametrize(
    "method", some(["total-variation", "wiener", "hyper-laplacian", "l-bfgs-b"], 0, 3)
)
def test_a_dark_level_that_is_too_high_is_named(frames, method):
    """Whatever the method makes of it, and not where nothing but noise lies below 0."""
    frame = frames[0][:120, :120]
    assert causes(frame - np.quantile(frame, 0.3), disk(5.0), NOISE, method) == ["dark"]
    assert causes(frame - frame.min(), disk(5.0), NOISE, method) == []
    dark = np.random.default_rng(1).normal(0, NOISE, frame.shape)
    dark[60:90, 60:90] += fftconvolve(np.ones((30, 30)), disk(5.0), mode="same")
    assert "dark" not in causes(dark, disk(5.0), NOISE, method)


def test_the_residual_is_that_of_the_picture_that_is_returned():
    """A few stars on black, whose rings below 0 are cut; scipy blurs what is left of them."""
    rng = np.random.default_rng(2)
    sky = np.zeros((96, 96))
    sky[tuple(rng.integers(12, 84, (2, 40)))] = 1000 * rng.random(40)
    psf, noise = disk(3.0), 0.5
    frame = fftconvolve(sky, psf, mode="same") + rng.normal(0, noise, sky.shape)
    seen = build_observation(frame, psf, noise, "dark")
    for method in ("total-variation", "hyper-laplacian"):
        found = restore(seen, method=method)
        assert found.image.min() >= 0
        left = frame - fftconvolve(found.image, psf, mode="same")
        assert found.residual == pytest.approx(np.sqrt(np.mean(left**2)) / noise, rel=1e-3)
        whole = residual_map(seen, found)
        assert np.allclose(whole, left / noise, atol=0.1)


def test_negative_light_that_was_cut_is_named_with_what_helps():
    rng = np.random.default_rng(2)
    sky = np.zeros((126, 126))
    sky[tuple(rng.integers(12, 114, (2, 60)))] = 1000 * rng.random(60) ** 3
    frame = fftconvolve(sky, disk(5.3), mode="same")[15:-15, 15:-15]
    seen = build_observation(frame + rng.normal(0, 0.5, frame.shape), disk(5.3))
    cut, kept = restore(seen), restore(seen, method="l-bfgs-b")
    assert cut.residual > cut.uncut_residual
    (one,) = judge_restoration(seen, cut).findings
    assert one.cause == "negative"
    assert "l-bfgs-b" in one.remedy
    assert judge_restoration(seen, kept).is_good
    truth = sky[15:-15, 15:-15]
    assert np.mean((kept.image - truth) ** 2) < 0.5 * np.mean((cut.image - truth) ** 2)


@each_photograph
def test_levels_of_a_camera_that_arent_clipped_arent_named(frames, number):
    """Whole levels repeat, also the highest; a clipped one stands out from its neighbour."""
    levels = np.rint(200 * frames[number]).astype(np.int16)
    assert "clipping" not in causes(levels, disk(5.0))
    assert "clipping" in causes(levels.clip(max=int(np.quantile(levels, 0.9))), disk(5.0))


def test_the_words_say_what_to_do(frames):
    seen = build_observation(frames[0], disk(5.0), 3 * NOISE)
    words = str(judge_restoration(seen, restore(seen)))
    assert "0.018" in words
    assert "leave it out" in words
