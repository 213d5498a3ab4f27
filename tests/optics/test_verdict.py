"""Verdicts on restorations: what is right is called good, and what is wrong is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import fftconvolve
from skimage import data
from test_model_error import capture, disturb, photographs, shake

from labapp.accuracy.blurs import disk
from optics.deconvolution import build_observation, find_psf_scale, judge_restoration, restore

NOISE = 0.006


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
def test_what_is_right_is_called_good(frames, noise, method):
    for frame in frames:
        assert causes(frame, disk(5.0), noise, method) == []


def test_what_was_told_wrongly_is_named(frames):
    for frame in frames:
        assert causes(frame, disk(5.0), 3 * NOISE) == ["noise"]
        assert causes(frame, disk(5.0), NOISE / 3) == ["noise"]
        assert causes(frame, disk(5.0), 0.0) == ["noise"]
        assert causes(frame, disk(5.25))[0] == "psf-scale"
        assert causes(frame.clip(max=np.quantile(frame, 0.97)), disk(5.0))[0] == "clipping"


def test_a_wrong_shape_is_named_as_the_psfs_error():
    for number, scene in enumerate(photographs()):
        _, frame = capture(scene, shake(number), 0.0015)
        assert "psf" in causes(frame, disturb(shake(number), 0.6, number))


def test_few_iterations_are_named(frames):
    assert causes(frames[0], disk(5.0), NOISE, "richardson-lucy", 2) == ["iterations"]


def test_levels_of_a_camera_that_arent_clipped_arent_named(frames):
    """Whole levels repeat, also the highest; a clipped one stands out from its neighbour."""
    for frame in frames:
        levels = np.rint(200 * frame).astype(np.int16)
        assert "clipping" not in causes(levels, disk(5.0))
        assert "clipping" in causes(levels.clip(max=int(np.quantile(levels, 0.9))), disk(5.0))


def test_the_words_say_what_to_do(frames):
    seen = build_observation(frames[0], disk(5.0), 3 * NOISE)
    words = str(judge_restoration(seen, restore(seen)))
    assert "0.018" in words
    assert "leave it out" in words
