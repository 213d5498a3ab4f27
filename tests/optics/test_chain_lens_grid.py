"""How wide a band and how fine a grid a chain takes: what each leaves out, added up directly."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.plane import Plane
from optics.psf.edge_scatter import StopEdgeScatter
from optics.psf.lens_grid import (
    BandTaper,
    LensGridSearch,
    _cumulative_light_outwards,
    _cutoff_for_lost_light,
    choose_lens_grid,
)
from optics.psf.request import PSFRequest

TOL = 3e-3
CAMERA = Camera(Panel((60, 80), 8e-6), Lens(0.05, 0.05 / 0.4e-3, 2.0), separation=5e-3)
WINDOW = Plane((30, 40), (4e-6, 5e-6))
QUESTION = PSFRequest(CAMERA.lens, 1.5, 550e-9, WINDOW, TOL, Budget(), separation=5e-3)


@pytest.fixture(scope="module")
def edge() -> StopEdgeScatter:
    return StopEdgeScatter(QUESTION, CAMERA)


@pytest.fixture(scope="module")
def search(edge) -> LensGridSearch:
    return LensGridSearch(edge)


@pytest.fixture(scope="module")
def grid(search):
    return choose_lens_grid(QUESTION, CAMERA, search, TOL)


def outside(frequency, low, high):
    return ((frequency < low) | (frequency > high)).any(-1)


def left_out(edge, band, rate, passing=None):
    """Light, by ray: what a band leaves out, what a grid's gray edge fails to turn of the rest, and
    what its own frequencies turn back into the window.

    passing: a band of which alone the last two count.
    """
    rays, low, high = edge.scattered_rays, *map(np.array, band)
    beyond = outside(rays.frequency, low, high)
    missing = rays.light[beyond].sum()
    inner = (low, high) if passing is None else passing
    kept = np.sinc(edge.edge_frequency_shift / np.array(rate)).prod(-1)
    turned = rays.light * ~outside(rays.frequency, *inner)
    missing_turns = (turned * (1 - kept) ** 2).sum()
    back = 0.0
    for way in itertools.product((-1, 0, 1), repeat=2):
        if way == (0, 0):
            continue
        accepted, shift = edge._accepted_frequencies[:, 0], edge.edge_frequency_shift[:, 0]
        behind = accepted + np.array(way) * rate - shift
        again = edge.trace_rays(edge._edge_points[:, None], behind)
        inside = ~outside(again.frequency, *inner)
        weight = edge._density * len(edge._window)
        back += (again.light * weight * kept[:, 0] ** 2 * inside).sum()
    return missing, missing_turns + back


def test_a_grid_keeps_the_tolerance_with_all_that_it_leaves_out(edge, grid):
    missing, lost = left_out(edge, (grid.low, grid.high), grid.sampling_rate)
    # Beside the panel, light from anywhere stands for what is lit, so a little more counts.
    assert edge.relative_error(missing + lost) <= grid.error * 1.001
    assert edge.relative_error(missing + lost) > 0.8 * grid.error
    assert 0.3 * TOL < grid.error <= TOL


def test_the_share_of_what_passes_straight_is_told_apart(edge, search, grid):
    _, lost = left_out(edge, (grid.low, grid.high), grid.sampling_rate, edge.passing_band)
    assert search.passing_error_share(grid) == pytest.approx(
        (edge.relative_error(lost) / grid.error) ** 2
    )
    assert 0 < search.passing_error_share(grid) < 1
    assert search.passing_error_share(replace(grid, error=0.0)) == 0
    assert search.passing_error_share(replace(grid, error=1e-9)) == 1


def test_a_band_leaves_out_no_more_than_it_may_and_ends_softly_around_what_passes(edge, search):
    soft, widths = np.array([500.0, 900.0]), []
    for error in (1e-3, 3e-3, 1e-2):
        low, high = search.find_band(error, soft)
        rays = edge.scattered_rays
        gone = rays.light[outside(rays.frequency, low, high)].sum()
        assert gone <= edge.allowed_light_loss(error)
        assert (low <= edge.passing_band[0] - soft).all()
        assert (high >= edge.passing_band[1] + soft).all()
        widths.append(np.prod(high - low))
        # Two sides share a half of what may go, so that each is left out once at the least.
        assert (
            gone > 0.1 * edge.allowed_light_loss(error)
            or (high == edge.passing_band[1] + soft).any()
        )
    assert widths == sorted(widths, reverse=True)
    assert widths[0] > 1.2 * widths[-1]
    wider = [
        np.subtract(*search.find_band(3e-3, soft, unbounded_panel=one)[::-1])
        for one in (True, False)
    ]
    assert (wider[0] >= wider[1]).all()


def test_the_grid_is_the_cheapest_of_three_shares_of_the_tolerance(search, grid):
    soft = np.array([BandTaper.for_axis(QUESTION, CAMERA, axis).width for axis in (0, 1)])
    sizes = [np.prod(one.sampling_rate) for share in (0.3, 0.5, 0.7)
             if (one := search.find_coarsest_grid(share * TOL, TOL, soft))]  # fmt: skip
    assert np.prod(grid.sampling_rate) == min(sizes)
    # Twice what there is: all frequencies of the band and of the window are sampled.
    reach = (
        np.maximum(np.abs(grid.low), np.abs(grid.high)) / search.edge_scatter.shadow_magnification
    )
    assert (
        np.array(grid.sampling_rate)
        >= 1.25 * (reach + search.edge_scatter.max_window_frequency) * 0.999
    ).all()


def test_a_finer_tolerance_takes_a_finer_grid_until_none_keeps_it(search):
    rates = [choose_lens_grid(QUESTION, CAMERA, search, tol).sampling_rate for tol in (1e-2, 3e-3)]
    assert np.prod(rates[0]) < np.prod(rates[1])
    with pytest.raises(ToleranceError):
        choose_lens_grid(QUESTION, CAMERA, search, 1e-9)


def test_light_is_added_up_from_outside_in_steps_of_half_a_percent():
    rng = np.random.default_rng(0)
    frequency, light = rng.normal(0, 3e3, 4000), rng.random(4000)
    end, zone = 500.0, 200.0
    reached, outwards = _cumulative_light_outwards(frequency, light, end, zone)
    for share in (0.001, 0.01, 0.1, 0.4):
        lost = share * light.sum()
        found = _cutoff_for_lost_light(reached, outwards, lost)
        assert light[frequency > found].sum() <= lost
        closer = end + (found - end + zone) / 1.0102 - zone
        assert light[frequency > closer].sum() >= 0.99 * lost
    # Of no light at all, none is beyond anything.
    assert _cutoff_for_lost_light(reached, outwards, 1.01 * light.sum()) == -np.inf
    nothing, none = _cumulative_light_outwards(np.array([end - 1.0]), np.array([1.0]), end, zone)
    assert (len(nothing), none.tolist()) == (1, [1.0])
