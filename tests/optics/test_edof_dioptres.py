"""Depths in dioptres: conversion, draws over a range, and samplers that leave a depth out."""

import math
import random

import pytest
import torch

from optics.edof.dioptres import (
    PUBLISHED_DIOPTRES,
    PUBLISHED_DISTANCES,
    dioptres_from_metres,
    find_undrawn,
    metres_from_dioptres,
    midpoint_dioptres,
    random_dioptres,
    stratified_dioptres,
)


def test_the_published_distances_are_those_of_equation_5_11():
    assert PUBLISHED_DISTANCES == (0.5, 0.62, 0.75, 0.8, 1, 1.5, 2, 3.5, 5, 50)
    assert PUBLISHED_DIOPTRES[0] == 2
    assert PUBLISHED_DIOPTRES[-1] == 0.02


def test_infinity_is_zero_dioptres_both_ways():
    assert dioptres_from_metres([math.inf, 0.5]) == (0, 2)
    assert metres_from_dioptres([0, 2, 0.02]) == (math.inf, 0.5, 50)


@pytest.mark.parametrize("bad", [0, -1, math.nan])
def test_a_distance_must_be_positive(bad):
    with pytest.raises(ValueError, match="distances holds"):
        dioptres_from_metres([1, bad])


@pytest.mark.parametrize("bad", [-0.1, math.inf, math.nan])
def test_a_depth_must_be_finite_and_not_negative(bad):
    with pytest.raises(ValueError, match="dioptres"):
        metres_from_dioptres([bad])


def test_no_depth_at_all_is_refused():
    with pytest.raises(ValueError, match="is empty"):
        metres_from_dioptres([])


def test_midpoints_integrate_a_straight_line_without_error():
    depths = midpoint_dioptres(7, (0.3, 1.7))
    assert len(depths) == 7
    assert sum(depths) / 7 == pytest.approx(1.0)
    assert depths[0] == pytest.approx(0.3 + 0.1)


def test_a_seed_gives_the_same_random_depths_within_the_range():
    first, again = (random_dioptres(40, torch.Generator().manual_seed(4)) for _ in range(2))
    assert first == again
    assert first != random_dioptres(40, torch.Generator().manual_seed(5))
    assert all(0 <= one <= 2 for one in first)


def test_random_depths_are_uniform_in_dioptres():
    depths = random_dioptres(4000, torch.Generator().manual_seed(1), (1.0, 2.0))
    counts = torch.histc(torch.tensor(depths), bins=8, min=1, max=2)
    # The chi-squared statistic of 7 degrees of freedom exceeds 24.3 once in 1000.
    assert float(((counts - 500) ** 2 / 500).sum()) < 24.3


def test_each_part_of_the_range_gets_one_stratified_depth():
    depths = stratified_dioptres(10, torch.Generator().manual_seed(2), (0.5, 1.5))
    assert [int((one - 0.5) * 10) for one in depths] == list(range(10))


@pytest.mark.parametrize("draw", [midpoint_dioptres, stratified_dioptres, random_dioptres])
@pytest.mark.parametrize(
    ("count", "depth_range", "name"),
    [(0, (0, 2), "count"), (3, (2, 0), "depth_range"), (3, (1, 1), "depth_range"),
     (3, (-1, 2), "depth_range")],
)  # fmt: skip
def test_draws_refuse_bad_counts_and_ranges(draw, count, depth_range, name):
    given = () if draw is midpoint_dioptres else (torch.Generator(),)
    with pytest.raises(ValueError, match=name):
        draw(count, *given, depth_range)


def test_an_index_that_never_reaches_the_last_depth_is_found():
    """The fault of the published test script: int(u (n - 1)) with u below 1."""
    generator = random.Random(1)
    assert find_undrawn(lambda: int(generator.random() * 9), 10) == (9,)


def test_a_sampler_that_draws_every_depth_is_not_accused():
    for seed in range(20):
        generator = random.Random(seed)
        assert find_undrawn(lambda g=generator: int(g.random() * 13), 13) == ()
    assert find_undrawn(lambda: 0, 1) == ()


def test_a_sampler_must_stay_within_the_list():
    with pytest.raises(ValueError, match="draw_index gave 3"):
        find_undrawn(lambda: 3, 3)
    with pytest.raises(ValueError, match="miss_probability"):
        find_undrawn(lambda: 0, 3, miss_probability=0)
