import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from optics.slm.coupling import fringing_field_mean

FINER = 64


def brute_force(phase, sigma, side):
    """Every pixel as 64 x 64 samples, blurred by scipy, averaged over the active square."""
    fine = np.kron(phase, np.ones((FINER, FINER)))
    fine = gaussian_filter(fine, sigma * FINER, mode="nearest", truncate=6)
    place = (np.arange(FINER) + 0.5) / FINER - 0.5
    inside = np.clip((side / 2 - np.abs(place)) * FINER + 0.5, 0, 1)
    inside /= inside.sum()
    shape = (phase.shape[0], FINER, phase.shape[1], FINER)
    return np.einsum("iajb,a,b->ij", np.exp(1j * fine).reshape(shape), inside, inside)


def random(waves, shape=(6, 7), seed=0):
    return np.random.default_rng(seed).uniform(0, 2 * np.pi * waves, shape)


def ramp_with_wraps(levels, waves=1):
    """A blaze that flies back by so many waves."""
    return np.tile((np.arange(18) * 0.7) % (2 * np.pi * waves), (3, 1)) + levels


@pytest.mark.parametrize(
    ("sigma", "fill"),
    [
        (0.25, 0.87),
        (0.1, 1.0),
        *(
            pytest.param(*pair, marks=pytest.mark.sweep)
            for pair in [(0.1, 0.87), (1.0, 0.87), (0.25, 1.0), (1.0, 1.0)]
        ),
    ],
)
@pytest.mark.parametrize(
    "phase",
    [random(0.1), random(1), random(3), ramp_with_wraps(0.0), ramp_with_wraps(1.0, 3)],
    ids=["gentle", "a wave", "three waves", "blaze", "blaze of three waves"],
)
def test_neighbours_blur_the_phase_as_on_a_fine_grid(phase, sigma, fill):
    """The grid itself is wrong by up to 1e-3, where the phase jumps within few samples."""
    side = math.sqrt(fill)
    field = fringing_field_mean(torch.from_numpy(phase), sigma, side).numpy()
    truth = brute_force(phase, sigma, side)
    assert np.linalg.norm(field - truth) <= 2e-3 * np.linalg.norm(truth)
    assert np.abs(field - truth).max() <= 3e-3 + 1e-3


def test_one_edge_is_an_error_function():
    """The mean over a pixel beside a step, by a million points of the blurred staircase."""
    sigma, side, step = 0.25, 0.9, 4.0
    x = (np.arange(1_000_000) + 0.5) / 1e6 * side - side / 2
    beside = np.exp(1j * step * 0.5 * (1 + erf((x - 0.5) / (sigma * np.sqrt(2))))).mean()
    phase = torch.zeros(3, 12, dtype=torch.float64)
    phase[:, 6:] = step
    assert abs(complex(fringing_field_mean(phase, sigma, side)[1, 5]) - beside) <= 3e-3


def test_a_fly_back_within_the_pixel_costs_light():
    """Alone the wrapped and the smooth blaze are the same; coupled, the wrapped one loses."""
    wrapped = torch.from_numpy(ramp_with_wraps(0.0))
    smooth = torch.from_numpy(np.tile(np.arange(18) * 0.7, (3, 1)))
    assert torch.allclose(torch.exp(1j * wrapped), torch.exp(1j * smooth))
    order = torch.exp(-1j * smooth)
    light = [abs((fringing_field_mean(p, 0.3, 0.93) * order).mean()) for p in (smooth, wrapped)]
    assert light[1] ** 2 < 0.95 * light[0] ** 2


@pytest.mark.parametrize("phase", [0.0, 1.0, -7.0, 1e5])
@pytest.mark.parametrize("sigma", [1e-6, 0.3, 1.0])
def test_an_even_phase_has_no_neighbours(phase, sigma):
    even = torch.full((5, 4), phase, dtype=torch.float64)
    assert torch.allclose(
        fringing_field_mean(even, sigma, 0.93), torch.exp(1j * even), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_a_panel_may_be_smaller_than_the_blur(shape):
    phase = random(1, shape)
    field = fringing_field_mean(torch.from_numpy(phase), 1.0, 0.93).numpy()
    assert np.allclose(field, brute_force(phase, 1.0, 0.93), atol=1e-3)


def test_little_coupling_leaves_the_pixels_alone():
    phase = torch.from_numpy(random(1))
    assert torch.allclose(
        fringing_field_mean(phase, 1e-4, 0.93), torch.exp(1j * phase), rtol=0, atol=1e-6
    )


def test_no_pixel_becomes_brighter():
    for sigma in (0.05, 0.2, 1.0):
        assert (
            float(fringing_field_mean(torch.from_numpy(random(2)), sigma, 1.0).abs().max())
            <= 1 + 1e-12
        )


def test_pictures_come_in_batches():
    phase = torch.from_numpy(random(1, (2, 3, 7, 8)))
    together = fringing_field_mean(phase, 0.2, 0.93)
    assert together.shape == phase.shape
    alone = fringing_field_mean(phase[1, 2], 0.2, 0.93)
    assert float((together[1, 2] - alone).abs().max()) <= 3e-3


def test_single_precision_is_kept():
    phase = torch.from_numpy(random(1))
    field = fringing_field_mean(phase.float(), 0.2, 0.93)
    assert field.dtype == torch.complex64
    assert float((field - fringing_field_mean(phase, 0.2, 0.93)).abs().max()) <= 1e-5


@pytest.mark.parametrize("sigma", [0.1, 0.7])
def test_the_field_is_differentiable(sigma):
    phase = torch.from_numpy(random(1, (3, 3))).requires_grad_()
    for check in (torch.autograd.gradcheck, torch.autograd.gradgradcheck):
        assert check(lambda p: fringing_field_mean(p, sigma, 0.93, nodes=4), phase)


def test_where_all_phases_are_zero_the_gradient_is_finite():
    phase = torch.zeros(4, 5, dtype=torch.float64, requires_grad=True)
    fringing_field_mean(phase, 0.2, 0.93).real.sum().backward()
    assert phase.grad is not None
    assert not phase.grad.any()


def test_steps_that_no_panel_shows_are_refused():
    with pytest.raises(
        ValueError, match=r"phase steps by .* wrap the phase into the panel's range"
    ):
        fringing_field_mean(torch.tensor([[0.0, 1e5]]), 0.2, 0.93)
