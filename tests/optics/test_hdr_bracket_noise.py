"""Gain and read noise of brackets that numpy's own generator makes."""

import numpy as np
import pytest

from optics.hdr import estimate_bracket_noise


def frames(gain, read_noise, times, black=64.0, white=4095, seed=1):
    rng = np.random.default_rng(seed)
    # Texture that is much stronger than the noise.
    rate = 10 ** rng.uniform(1.5, 4, (300, 400))
    return [
        np.clip(
            np.rint((rng.poisson(rate * t) + rng.normal(0, read_noise, rate.shape)) / gain + black),
            0, white,
        )
        for t in times
    ]  # fmt: skip


@pytest.mark.parametrize(("gain", "read_noise"), [(0.8, 3.0), (2.6, 6.0)])
@pytest.mark.parametrize("times", [(0.1, 0.4), (0.1, 0.2, 0.8)])
def test_gain_and_read_noise_are_those_of_the_frames(gain, read_noise, times):
    found = estimate_bracket_noise(frames(gain, read_noise, times), times, 64.0, 4095)
    assert found.gain == pytest.approx(gain, rel=0.04)
    assert found.read_noise == pytest.approx(read_noise, rel=0.15)
    assert abs(found.gain / gain - 1) < 5 * found.gain_deviation


def test_a_part_that_moved_changes_little():
    every = frames(1.0, 4.0, (0.1, 0.4))
    every[1][:10] = every[1][200:210]
    assert estimate_bracket_noise(every, (1, 4), 64.0, 4095).gain == pytest.approx(1.0, rel=0.15)


def test_frames_that_tell_no_noise_are_refused():
    every = frames(1.0, 4.0, (0.1, 0.4))
    with pytest.raises(ValueError, match="Add an exposure between them"):
        estimate_bracket_noise([every[0], np.full_like(every[0], 4095)], (1, 4), 64.0, 4095)
    smooth = np.full((300, 400), 500.0) + np.arange(400)
    rng = np.random.default_rng(2)
    flat = [smooth * k + 64 + rng.normal(0, 3, smooth.shape) / (1 + np.arange(400) / 100)
            for k in (1, 2)]  # fmt: skip
    with pytest.raises(ValueError, match="doesn't grow with the light"):
        estimate_bracket_noise(flat, (1, 2), 64.0, 4095)
