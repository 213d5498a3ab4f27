"""A star's place and light, fitted to bare pixels behind filters: stars of many fine points."""

from __future__ import annotations

import numpy as np
import pytest

from labapp.pictures.analysis.brackets import Bracket
from labapp.spectral.band_psfs import star_places
from labapp.spectral.star_spot import StarSpot, _gaussian_spot, _spot_slopes, fit_star_spot

SHAPE = (40, 44)


def draw_star(place, width, light):
    """A disc, smeared by a Gaussian, counted on pixels by 20000 points."""
    rng = np.random.default_rng(7)
    angle, radius = 2 * np.pi * rng.random(20_000), 0.6 * width * np.sqrt(rng.random(20_000))
    y = place[0] + radius * np.sin(angle) + rng.normal(0, 0.4 * width, 20_000)
    x = place[1] + radius * np.cos(angle) + rng.normal(0, 0.4 * width, 20_000)
    edges = [np.arange(n + 1) - 0.5 for n in SHAPE]
    return np.histogram2d(y, x, bins=edges)[0] * (light / 20_000)


def bayer(red, green, blue):
    filters = np.empty(SHAPE)
    filters[::2, ::2], filters[1::2, 1::2] = red, blue
    filters[::2, 1::2] = filters[1::2, ::2] = green
    return filters


@pytest.mark.parametrize("place", [(20.0, 22.0), (20.4, 21.7), (19.0, 23.5), (21.3, 22.0)])
@pytest.mark.parametrize(
    ("filters", "within"),
    [(np.ones(SHAPE), 0.03), (bayer(1.0, 0.3, 0.01), 0.06), (bayer(0.02, 1.0, 0.06), 0.06),
     (bayer(0.02, 0.06, 1.0), 0.12)],
)  # fmt: skip
def test_a_star_is_found_between_the_pixels_that_see_it(place, filters, within):
    light = 4e6
    rate = filters * draw_star(place, 0.9, light)
    spread = rate + 100.0
    rate = rate + np.random.default_rng(1).normal(0, np.sqrt(spread))
    near = np.unravel_index(np.argmax(rate / filters * (rate > 0.02 * rate.max())), SHAPE)
    found = fit_star_spot(rate, spread, filters, (int(near[0]), int(near[1])))
    assert np.hypot(found.y - place[0], found.x - place[1]) < within
    assert found.light == pytest.approx(light, rel=0.15)


def test_the_light_that_stays_in_the_middle_is_told_from_a_ring():
    filters = bayer(0.02, 0.06, 1.0)
    place = (20.2, 21.9)
    neutral = filters * draw_star(place, 0.9, 4e6)
    spot = fit_star_spot(neutral, neutral + 100, filters, (20, 22))
    y, x = np.indices(SHAPE)
    ring = np.abs(np.hypot(y - place[0], x - place[1]) - 8) < 1
    coded = filters * (ring * 4e4 + draw_star(place, 0.9, 3e5))
    assert spot.share_in(coded, coded + 100, filters) == pytest.approx(3e5, rel=0.12)
    assert spot.shape_on(*SHAPE).sum() == pytest.approx(1, abs=1e-6)


def test_clipped_pixels_are_left_out_and_darkness_has_no_star():
    rate = draw_star((20.0, 22.0), 1.5, 1e6)
    spread = rate + 10.0
    spread[20, 22], rate[20, 22] = np.inf, 1.0
    found = fit_star_spot(rate, spread, np.ones(SHAPE), (20, 22))
    assert (found.y, found.x) == pytest.approx((20, 22), abs=0.05)
    assert found.light == pytest.approx(1e6, rel=0.15)
    dark = np.zeros(SHAPE)
    assert fit_star_spot(dark, dark + 1, np.ones(SHAPE), (20, 22)) is None


def spot(y, x, deviation):
    return StarSpot(y, x, 0.5, 1.0, deviation)


def test_uncertain_bands_have_the_place_of_the_others():
    """By hand: weights 10000, 10000 and 4 for the second band at 0.5 pixels."""
    found = star_places([spot(10.0, 20.0, 0.01), spot(10.2, 20.3, 0.5), spot(10.0, 20.02, 0.01)],
                        (9, 9))  # fmt: skip
    assert found == pytest.approx(np.array([[10.0, 20.01]] * 3), abs=1e-3)
    apart = star_places([spot(10.0, 20.0, 0.01), spot(10.4, 20.0, 0.02)], (9, 9))
    assert apart == pytest.approx(np.array([[10.0, 20.0], [10.4, 20.0]]), abs=0.1)
    assert apart[1].tolist() == [10.4, 20.0]
    assert star_places([None, None], (9, 8)).tolist() == [[9, 8], [9, 8]]


def test_a_bracket_is_what_brightest_pixels_are_looked_for_in():
    from labapp.spectral.band_psfs import _brightest_pixel

    rest = {"clipped": 0.0, "dark": 0.0, "clipped_by_exposure": [0.0], "dark_frames": 1}
    pictures, gains = [], []
    for filters in (bayer(0.02, 0.06, 1.0), bayer(1.0, 0.01, 0.01)):
        rate = filters * draw_star((20.0, 22.0), 0.9, 1e5)
        pictures.append(Bracket("star", "neutral", 5e-7, [1.0], rate, rate + 1,
                                histogram=np.zeros((1, 4), dtype=np.int64), **rest))  # fmt: skip
        gains.append(filters)
    row, column = _brightest_pixel(pictures, gains)
    assert max(abs(row - 20), abs(column - 22)) <= 1


def test_a_spot_changes_with_its_parameters_as_its_slopes_say():
    places, found = (np.arange(5, 22), np.arange(30, 47)), np.array([12.3, 38.8, 0.3, 2.1])
    for number, slope in enumerate(_spot_slopes(places, found)):
        step = 1e-5 * np.eye(4)[number]
        ends = [_gaussian_spot(places, found + sign * step) for sign in (1, -1)]
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-8)
