"""Random cameras whose panel stands apart from the lens, against a judge that shares no code.

The judge is tested in tests/labapp/test_chain_accuracy.py, against sums that are written out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from figures.chains import ChainProblem, chains, tally, unreal
from sweeps import some

from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.plane import Plane

TERMS = 4e8
"""Products that the judge may sum for one problem."""

BUDGET = Budget(1 << 30)


def small(seed: int, tol: float = 0.0) -> Iterator[ChainProblem]:
    """Random chains that the judge is soon done with; tol: for all, where it isn't 0."""
    for problem in chains(seed, most=60):
        quick = problem.build_reference(np.ones(problem.pixels.shape)).product_count < TERMS
        if quick and problem.camera.separation and max(problem.pixels.shape) < 120:
            yield replace(problem, tol=tol or problem.tol)


@pytest.mark.parametrize("count", [3, *(pytest.param(n, marks=pytest.mark.sweep) for n in (6, 20))])
def test_random_chains_keep_their_tolerance(count):
    found = tally(small(11), count, BUDGET, most=TERMS)
    assert found.wrong == ()
    assert found.unreal == ()
    assert found.accepted >= 0.9 * count
    assert found.judged == found.accepted


@pytest.mark.parametrize(
    ("method", "tol"), some([("chain", 1e-3), ("chain", 3e-2), ("chain, quadrature", 1e-3)], 0, 2)
)
def test_each_method_keeps_what_it_promises(method, tol):
    for problem in islice(small(12, tol), 2):
        operator = problem.operator(tol, method=method, budget=BUDGET)
        light = problem.light(operator)
        assert problem.build_reference(light).error(light) <= tol, problem.description


@pytest.mark.parametrize(
    ("distance", "field"), some([(math.inf, (2e-4, -3e-4)), (0.5, (0.0, 0.0))])
)
def test_a_stop_that_cuts_nothing_collapses(distance, field):
    """A wide stop, and a pattern that sends no light to its edge."""
    panel = Panel((48, 56), 12e-6, unmodulated=0.0)
    camera = Camera(panel, Lens(0.05, 50.0 / 4, 2.0), separation=0.02)
    y, x = (np.linspace(-1, 1, n) for n in panel.shape)
    phase = 6 * (y[:, None] ** 3 + x**3)
    pixels = Plane((24, 20), (4e-6, 4e-6))
    problem = ChainProblem(camera, distance, 520e-9, pixels, False, 5e-2, phase, field)
    light = problem.light(problem.operator(5e-2, method="collapsed"))
    assert problem.build_reference(light).error(light) <= 5e-2


def test_a_panel_at_the_lens_is_judged_as_before():
    """Fields off the axis move nothing there, and the chain's arguments are taken all the same."""
    found = 0
    for problem in islice((one for one in chains(13, most=60) if any(one.off_axis)), 3):
        near = replace(problem.camera, separation=0.0)
        problem = replace(problem, optics=near, tol=1e-3, sphere=False)
        light = problem.light(problem.operator(1e-3))
        judge = problem.build_reference(light)
        if judge.product_count < 3e8:
            found += 1
            assert judge.error(light) <= 1e-3, problem.description
    assert found


def test_less_memory_than_is_needed_is_refused_with_what_is_needed():
    problem = replace(next(small(14)), tol=1e-3)
    little = Budget(1 << 18)
    with pytest.raises(ToleranceError, match="MB at least") as refused:
        problem.operator(1e-3, budget=little)
    assert unreal(problem, refused.value, little, TERMS) == ""


@pytest.mark.parametrize(
    ("order", "modulated_only", "together"),
    [(0.0, True, False), (1.0, False, False), (-1.0, True, True)],
)
def test_dim_parts_of_a_sum_take_no_stricter_engine(order, modulated_only, together):
    """A grating beside light that it doesn't modulate: in the window of either, the other is dim.

    Its error counts as a share of both. Where both are dim, a stricter engine stands in.
    """
    turns, columns = 0.2, np.arange(48)
    panel = Panel((40, 48), 12e-6, unmodulated=0.05)
    camera = Camera(panel, Lens(0.05, 90.0, 2.0), separation=0.03)
    place = (0.0, order * turns / panel.pitch * 520e-9 * camera.ray_matrix_b)
    grating = np.tile(2 * np.pi * turns * columns, (40, 1))
    plane = Plane((16, 16), (8e-6, 8e-6), place)
    for share, stands_in in ((0.0, modulated_only), (0.05, together)):
        optics = replace(camera, panel=replace(panel, unmodulated=share))
        problem = ChainProblem(optics, 2.0, 520e-9, plane, False, 1e-3, grating)
        operator = problem.operator(1e-3, method="chain")
        planned = operator.account.sampling
        light = problem.light(operator)
        assert (operator.account.sampling != planned) == stands_in
        assert problem.build_reference(light).error(light) <= operator.account.error <= 1e-3


def test_unmodulated_light_is_computed_again_where_its_error_counts():
    """It is first taken as it comes; alone, and beside a pattern that is dimmer yet, it isn't."""
    panel = Panel((40, 48), 12e-6, unmodulated=0.5)
    camera = Camera(panel, Lens(0.05, 60.0, 2.0), separation=0.03)
    plane, columns = Plane((16, 16), (8e-6, 8e-6), (0.0, 7.5e-4)), np.arange(48)
    grating = np.tile(-2 * np.pi * 0.2 * columns, (40, 1))
    problem = ChainProblem(camera, 2.0, 520e-9, plane, False, 1e-3, grating)
    operator = problem.operator(1e-3, method="chain")
    light = problem.light(operator)
    assert problem.build_reference(light).error(light) <= operator.account.error <= 1e-3
    alone = replace(problem, phase=np.zeros(panel.shape))
    light = np.asarray(operator.unmodulated_psf())
    assert alone.build_reference(light).error(light) <= 1e-3
