"""Bounds on how far PSFs are apart, against the PSFs: Fourier transforms of the two fields."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from optical_situations import CAMERA, situation

from optics.camera import Panel
from optics.polarisation import PathEffect
from simulator.effects.field_distance import (
    PixelSample,
    describe_proof,
    has_coherent_background,
    margin,
    phase_error_psf_bound,
    psf_distance_bound,
)

ACROSS = 24
ALL = PixelSample(1, 1, torch.ones(ACROSS, ACROSS, dtype=torch.float64))


def drawn(seed: int, phase: float, loss: float = 0.0) -> torch.Tensor:
    """A field whose amplitudes lie between 1 - loss and 1, and phases within +-phase."""
    rng = np.random.default_rng(seed)
    turned = rng.uniform(-phase, phase, (ACROSS, ACROSS))
    return torch.from_numpy((1 - loss * rng.random((ACROSS, ACROSS))) * np.exp(1j * turned))


def psf(field: torch.Tensor) -> torch.Tensor:
    """Its sum is the mean square of the field (Parseval)."""
    return torch.fft.fft2(field).abs().square() / ACROSS**4


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("change", [1e-3, 0.1, 1.0])
def test_a_bound_of_two_fields_is_kept_and_near_what_changes(loss, change):
    for seed in range(5):
        one = drawn(seed, 3.0, loss)
        other = one * drawn(100 + seed, change)
        changed = float((psf(one) - psf(other)).abs().sum())
        bound = psf_distance_bound(ALL, one, other)
        assert changed <= bound <= 4 * changed


def test_a_darker_field_is_as_far_away_as_the_light_that_it_lacks():
    """(1 + a) |1 - a|, which is 1 - a² then: the bound is the change itself."""
    bright = drawn(1, 3.0)
    assert psf_distance_bound(ALL, bright, 0.5 * bright) == pytest.approx(0.75)
    assert psf_distance_bound(ALL, 0.5 * bright, bright) == pytest.approx(0.75)


def test_the_same_phase_on_all_pixels_is_no_difference():
    one = drawn(2, 3.0, 0.5)
    assert psf_distance_bound(ALL, one, one * complex(math.cos(2), math.sin(2))) < 1e-6


@pytest.mark.parametrize("interference", [0.0, 0.3 + 0.2j])
def test_a_common_phase_counts_where_other_light_interferes(interference):
    parts = (torch.tensor(0.5), torch.tensor(0.05), torch.tensor(interference))
    s = situation(path=PathEffect(*parts))
    error = torch.full((ACROSS, ACROSS), 0.01, dtype=torch.float64)
    assert has_coherent_background(s) == bool(interference)
    beats = abs(interference)
    wanted = (2 + beats) * 2 * math.sin(0.005) if beats else 0.0
    assert phase_error_psf_bound(s, ALL, error) == pytest.approx(wanted, abs=1e-6)


def test_the_light_of_the_gap_interferes_too():
    assert not has_coherent_background(situation())
    camera = replace(CAMERA, panel=replace(CAMERA.panel, fill_factor=0.9, gap_reflection=0.1))
    assert has_coherent_background(situation(camera=camera))


@pytest.mark.parametrize(
    ("across", "factor", "word"), [(256, 1.0, "proved"), (257, 1.2, "audited")]
)
def test_a_panel_of_which_pixels_are_left_out_has_a_margin(across, factor, word):
    s = situation(camera=replace(CAMERA, panel=Panel((8, across), 8e-6)))
    assert margin(s) == factor
    assert describe_proof(s, "sums").startswith(word)


def test_pixels_count_by_the_light_that_the_stop_lets_through():
    half_open = PixelSample(1, 1, torch.tensor([[1.0, 0.5]], dtype=torch.float64))
    values = torch.tensor([[2.0, 6.0]], dtype=torch.float64)
    assert half_open.mean(values) == pytest.approx((2 + 6 / 4) / (1 + 1 / 4))
