"""Plug-and-play restoration, with a denoiser of another library: total variation, Chambolle's."""

import math

import numpy as np
import pytest
import torch
from skimage.restoration import denoise_tv_chambolle
from test_total_variation import blurred, comet, disk, photograph, psnr, seen

from optics.inverse.plug_and_play import Denoiser, load_denoiser, plug_and_play
from optics.inverse.total_variation import total_variation
from optics.progress import Cancelled, Progress


def chambolle(picture, noise, axes=None):
    return torch.stack(
        [
            torch.from_numpy(denoise_tv_chambolle(one.double().numpy(), 1.2 * float(level)))
            for one, level in zip(picture, noise, strict=True)
        ]
    ).to(picture)


@pytest.mark.parametrize("border", ["unknown", "periodic"])
def test_with_a_denoiser_of_total_variation_it_restores_about_as_total_variation_does(border):
    truth, frame = blurred(photograph(), disk(3.0), 0.01)
    problem = seen(frame, disk(3.0), 0.01, border)
    ours = plug_and_play(problem, chambolle)
    if border == "unknown":
        assert psnr(ours.image, truth) > psnr(total_variation(problem).image, truth) - 1
        assert ours.residual == pytest.approx(1, abs=0.25)
    assert np.isfinite(ours.image.numpy()).all()


def test_pixels_without_trust_are_what_the_denoiser_makes_of_them():
    truth, frame = blurred(photograph(), disk(3.0), 0.01)
    dead = np.random.default_rng(1).random(frame.shape) < 0.05
    weights = (~dead).astype(np.float32)
    broken = np.where(dead, 3.0, frame)
    whole = plug_and_play(seen(frame, disk(3.0), 0.01), chambolle).image
    known = plug_and_play(seen(broken, disk(3.0), 0.01, weights=weights), chambolle).image
    assert psnr(known, truth) > psnr(whole, truth) - 0.5


def test_the_denoiser_is_told_falling_levels_of_a_picture_with_white_at_one():
    heard = []

    def denoise(picture, noise, axes=None):
        level = float(noise)
        heard.append((float(picture.quantile(0.99)), level))
        return picture.clone()

    _, frame = blurred(photograph(96), comet(), 0.02)
    plug_and_play(seen(300 * frame, comet(), 6.0), denoise, rounds=4)
    whites, levels = zip(*heard, strict=True)
    assert all(0.8 < white < 1.2 for white in whites)
    assert levels[0] > levels[1] > levels[2] > levels[3]
    assert levels[-1] == pytest.approx(0.02 / max(frame.max(), 1e-9), rel=0.2)


def test_a_cancel_stops_it_and_nonsense_is_refused():
    _, frame = blurred(photograph(64), comet(), 0.01)
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        plug_and_play(seen(frame, comet(), 0.01), chambolle, progress=progress)
    with pytest.raises(ValueError, match="rounds is 0"):
        plug_and_play(seen(frame, comet(), 0.01), chambolle, rounds=0)
    with pytest.raises(ValueError, match="strength is 0"):
        plug_and_play(seen(frame, comet(), 0.01), chambolle, strength=0.0)


@pytest.mark.parametrize("shape", [(16, 24), (17, 31), (8, 8)])
def test_the_network_takes_pictures_of_any_size(shape):
    torch.manual_seed(1)
    network = Denoiser().eval()
    picture = torch.rand(shape)
    assert network.denoise(picture, 0.1).shape == shape


def test_a_picture_twice_as_bright_is_denoised_to_one_twice_as_bright():
    torch.manual_seed(2)
    network, picture = Denoiser().eval(), torch.rand(16, 24)
    twice = network.denoise(2 * picture, 0.2)
    assert torch.allclose(twice, 2 * network.denoise(picture, 0.1), atol=1e-5)


def test_weights_that_dont_fit_are_refused():
    torch.manual_seed(3)
    weights = Denoiser().state_dict()
    again = load_denoiser(weights)
    picture = torch.rand(8, 8)
    assert not any(part.requires_grad for part in again.parameters())
    assert math.isfinite(float(again.denoise(picture, 0.1).sum()))
    weights.popitem()
    with pytest.raises(ValueError, match="weights don't fit"):
        load_denoiser(weights)
