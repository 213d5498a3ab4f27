"""The error expected of linear restoration, against closed forms, search and simulation."""

import math

import numpy as np
import pytest
import torch

from optics.edof.picture_spectrum import FrequencyGrid
from optics.edof.spectral_criterion import (
    blind_error,
    blind_filter,
    error_level,
    filter_error,
    known_depth_error,
    noise_at_light,
)

SHARES = torch.full((3, 4), 1 / 12, dtype=torch.float64)
SPECTRUM = torch.rand(3, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64) + 0.1


def _transfers(depths=3, seed=2):
    return torch.randn(
        depths, 3, 4, generator=torch.Generator().manual_seed(seed), dtype=torch.complex128
    )


def test_flat_transfer_has_the_wiener_error():
    spectrum, transfer = torch.full((3, 4), 0.04), torch.full((2, 3, 4), 0.3)
    expected = 0.04 * 0.01**2 / (0.04 * 0.09 + 0.01**2)
    for error in (blind_error, known_depth_error):
        assert float(error(transfer, spectrum, SHARES, 0.01)) == pytest.approx(expected, rel=1e-6)


def test_two_opposite_depths_leave_a_blind_filter_nothing():
    transfer = torch.stack([torch.ones(3, 4), -torch.ones(3, 4)])
    variance = float((SHARES * SPECTRUM).sum())
    assert float(blind_error(transfer, SPECTRUM, SHARES, 0.01)) == pytest.approx(variance)
    assert float(known_depth_error(transfer, SPECTRUM, SHARES, 0.01)) < 2e-4


def test_no_filter_is_better_than_the_blind_one():
    transfer, noise, shares = _transfers(), 0.3, SHARES.clone()
    # At zero frequency the filter keeps the mean instead.
    shares[0, 0] = 0.0
    best = blind_filter(transfer, SPECTRUM, noise)
    least = float(filter_error(best, transfer, SPECTRUM, shares, noise))
    assert least == pytest.approx(float(blind_error(transfer, SPECTRUM, shares, noise)))
    for seed in range(5):
        moved = best + 0.01 * _transfers(1, seed)[0]
        assert float(filter_error(moved, transfer, SPECTRUM, shares, noise)) > least


def test_blind_filter_keeps_the_mean():
    transfer = _transfers()
    kept = blind_filter(transfer, SPECTRUM, 0.1)[0, 0] * transfer[:, 0, 0].mean()
    assert abs(complex(kept) - 1) < 1e-12


def test_errors_are_those_of_simulated_captures():
    grid, noise = FrequencyGrid(32), 0.05
    fy, fx = grid.frequencies()
    radius = torch.hypot(fy, fx)
    spectrum = torch.where(radius > 0, 1e-3 / (radius**2 + 0.01), 0.0)
    turn = torch.exp(-2j * math.pi * (2 * fy + fx))
    transfer = torch.stack([torch.exp(-20 * radius**2) + 0j, 0.5 * turn * torch.exp(-radius)])
    rng = np.random.default_rng(5)
    white = rng.standard_normal((60, 32, 32))
    pictures = np.fft.rfft2(white) * spectrum.sqrt().numpy()
    found = {"blind": [], "known": []}
    blind = blind_filter(transfer, spectrum, noise).numpy()
    for one in transfer.numpy():
        seen = pictures * one + np.fft.rfft2(noise * rng.standard_normal(white.shape))
        power = spectrum.numpy()
        known = power * one.conj() / (power * np.abs(one) ** 2 + noise**2)
        for name, restoring in (("blind", blind), ("known", known)):
            lost = np.fft.irfft2(seen * restoring - pictures, s=white.shape[1:])
            lost = lost - lost.mean(axis=(1, 2), keepdims=True)
            found[name].append((lost**2).mean())
    shares = grid.shares()
    for name, error in (("blind", blind_error), ("known", known_depth_error)):
        expected = float(error(transfer, spectrum, shares, noise))
        assert np.mean(found[name]) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("error", [blind_error, known_depth_error])
def test_gradients_are_those_of_finite_differences(error):
    def real_error(real):
        return error(torch.view_as_complex(real), SPECTRUM, SHARES, 0.2)

    real = torch.view_as_real(_transfers(2)).clone().requires_grad_()
    assert torch.autograd.gradcheck(real_error, real)


def test_single_precision_and_zeros_stay_finite():
    transfer = torch.zeros(2, 3, 4).requires_grad_()
    for error in (blind_error, known_depth_error):
        value = error(transfer, SPECTRUM.float(), SHARES, 0.0)
        value.backward()
        assert value.dtype == torch.float64
        assert math.isfinite(float(value.detach()))
        assert bool(torch.isfinite(transfer.grad).all())
    assert bool(torch.isfinite(blind_filter(transfer.detach(), SPECTRUM, 0.0)).all())


def test_less_light_makes_more_noise():
    assert noise_at_light(0.01, 1.0, 0.5) == pytest.approx(0.01)
    assert noise_at_light(0.01, 0.25) == pytest.approx(0.04)
    assert noise_at_light(0.01, 0.25, 1.0) == pytest.approx(0.02)
    with pytest.raises(ValueError, match="light"):
        noise_at_light(0.01, 0.0)


def test_levels_are_in_dB():
    assert error_level(1e-3) == pytest.approx(30)
    with pytest.raises(ValueError, match="error"):
        error_level(0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"noise": -0.1}, "noise"),
        ({"noise": math.nan}, "noise"),
        ({"spectrum": torch.ones(3, 3)}, "spectrum"),
        ({"shares": torch.ones(4, 3)}, "shares"),
        ({"transfer": torch.ones(3, 4)}, "transfer"),
    ],
)
def test_bad_arguments_are_named(change, message):
    given = {"transfer": _transfers(), "spectrum": SPECTRUM, "shares": SHARES, "noise": 0.1}
    with pytest.raises(ValueError, match=message):
        blind_error(**(given | change))
