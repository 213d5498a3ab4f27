import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.integrate import quad, solve_ivp
from scipy.special import j0

from optics.slm.dynamics import (
    first_start_phase,
    relaxed_phase,
    steady_start_phases,
    time_node_count,
    time_nodes,
)
from optics.slm.modulator import flicker_nodes

FRAME = 1 / 60


def test_the_phase_follows_the_equation_of_first_order():
    """dp/dt = (end - p) / tau, integrated by scipy."""
    end, start, tau = 3.0, -1.0, 5e-3
    known = solve_ivp(lambda t, p: (end - p) / tau, (0, FRAME), [start], rtol=1e-10, atol=1e-12)
    phase = relaxed_phase(torch.tensor(end), torch.tensor(start), FRAME, tau)
    assert float(phase) == pytest.approx(known.y[0, -1], rel=1e-6)


@pytest.mark.parametrize("tau", [1e-3, 5e-3, 20e-3, 1.0])
@pytest.mark.parametrize("frames", [1, 2, 7])
def test_a_cycle_begins_where_it_ends(tau, frames):
    """After so many cycles from rest that nothing is left of the beginning."""
    phases = torch.rand(frames, 3, dtype=torch.float64) * 6
    starts = steady_start_phases(phases, FRAME, tau)
    state = torch.zeros(3, dtype=torch.float64)
    for _ in range(math.ceil(40 * tau / (frames * FRAME)) + 1):
        seen = []
        for phase in phases:
            seen.append(state)
            state = phase + (state - phase) * math.exp(-FRAME / tau)
    assert torch.allclose(starts, torch.stack(seen), rtol=0, atol=1e-12)


def test_at_once_a_frame_begins_with_the_one_before():
    phases = torch.rand(4, 2, 3)
    assert torch.equal(steady_start_phases(phases, FRAME, 0.0), phases.roll(1, 0))


@pytest.mark.parametrize("tau", [1e-9, 1e-5])
def test_a_quick_crystal_is_nearly_at_once(tau):
    phases = torch.rand(4, 3, dtype=torch.float64)
    assert torch.allclose(steady_start_phases(phases, FRAME, tau), phases.roll(1, 0), atol=1e-12)


def test_a_slow_crystal_stands_at_the_mean():
    """A million times slower than the video: the mean to within a millionth."""
    phases = torch.rand(5, 3, dtype=torch.float64) * 6
    starts = steady_start_phases(phases, FRAME, 1e6 * 5 * FRAME)
    assert torch.allclose(starts, phases.mean(0).expand(5, 3), rtol=0, atol=1e-5)


def test_the_starts_are_differentiable():
    phases = torch.rand(3, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: steady_start_phases(p, FRAME, 5e-3), phases)


@pytest.mark.parametrize("tau", [1e-4, 5e-3, 17e-3, 3.0])
@pytest.mark.parametrize("change", [0.1, 2 * math.pi, 13.0, 28.0])
def test_few_nodes_give_the_mean_light_of_a_frame(tau, change):
    """Mean of exp(i change exp(-t / tau)), by scipy's adaptive quadrature."""

    def wave(t, part):
        return part(change * math.exp(-t / tau))

    ends = [0.0, min(5 * tau, FRAME), FRAME]
    truth = sum(
        quad(wave, a, b, (math.cos,), epsabs=1e-13)[0]
        + 1j * quad(wave, a, b, (math.sin,), epsabs=1e-13)[0]
        for a, b in pairwise(ends)
    )
    for tol in (1e-2, 1e-3, 1e-6):
        times, shares = time_nodes(FRAME, tau, time_node_count(change, FRAME, tau, tol))
        mean = sum(
            s * np.exp(1j * change * math.exp(-t / tau)) for t, s in zip(times, shares, strict=True)
        )
        assert abs(mean - truth / FRAME) <= 1.01 * tol
        assert sum(shares) == pytest.approx(1, abs=1e-12)
        assert all(0 <= t <= FRAME for t in times)


def test_a_wave_of_change_takes_four_nodes_for_a_thousandth():
    """Equal steps in time take more than a hundred."""
    assert time_node_count(2 * math.pi, FRAME, 5e-3, 1e-3) == 4


def test_nodes_are_exact_for_polynomials_in_what_is_left():
    """Degree 5 of exp(-t / tau) with three nodes: (1 - exp(-k T)) / (k T)."""
    times, shares = time_nodes(1.0, 0.3, 3)
    for k in range(1, 6):
        mean = sum(s * math.exp(-k * t / 0.3) for t, s in zip(times, shares, strict=True))
        assert mean == pytest.approx((1 - math.exp(-k / 0.3)) / (k / 0.3), rel=1e-12)


@pytest.mark.parametrize("tau", [0.0, 1e-12, 1e-7, 1e3, 1e12])
@pytest.mark.parametrize("count", [1, 4, 12])
def test_extreme_crystals_have_nodes_inside_the_frame(tau, count):
    times, shares = time_nodes(FRAME, tau, count)
    assert 1 <= len(times) <= count
    assert sum(shares) == pytest.approx(1, abs=1e-12)
    assert all(0 <= t <= FRAME * (1 + 1e-12) for t in times)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: time_nodes(0.0, 1e-3, 3), "frame_time is 0 s"),
        (lambda: time_nodes(math.nan, 1e-3, 3), "frame_time is nan s"),
        (lambda: time_nodes(FRAME, -1.0, 3), "tau is -1 s"),
        (lambda: time_nodes(FRAME, math.inf, 3), "tau is inf s"),
        (lambda: time_nodes(FRAME, 1e-3, 0), "count is 0"),
        (lambda: first_start_phase(torch.zeros(0, 2), FRAME, 1e-3), "phases has no frame"),
        (lambda: time_node_count(1e3, FRAME, 5e-3, 1e-3), "changes by 1e.03 rad within a frame"),
        (lambda: flicker_nodes(0.5, 1e4, 1e-3), "moves the phase by 5e.03 rad"),
    ],
)
def test_what_cannot_be_followed_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


# Flicker


@pytest.mark.parametrize("tol", [1e-2, 1e-4, 1e-8])
@pytest.mark.parametrize("flicker", [1e-6, 0.01, 0.1, 1.0])
@pytest.mark.parametrize("phase", [0.0, 1.0, 21.0])
def test_flicker_dims_the_mean_field_by_bessels_function(phase, flicker, tol):
    """Mean over a period of exp(i phase (1 + flicker sin)) = exp(i phase) J0(flicker phase)."""
    nodes = flicker_nodes(flicker, phase, tol)
    mean = sum(share * np.exp(1j * phase * factor) for share, factor in nodes)
    assert abs(mean - np.exp(1j * phase) * j0(flicker * phase)) <= tol


def test_little_flicker_takes_few_nodes():
    """0.5 % of 6.7 pi moves the phase by a tenth of a radian."""
    assert len(flicker_nodes(0.005, 6.7 * math.pi, 1e-3)) == 2
    assert flicker_nodes(0.0, 21.0, 1e-3) == [(1.0, 1.0)]
