"""Audits find broken bounds and no others, on pictures that are written out by hand."""

import math

import pytest
import torch
from planning_toys import SITUATION, Toy

from simulator.planning import Bound, MinimumNorms, audit, plan_effects

PIXELS = 16
FLOOR = MinimumNorms(1000.0, 1000.0, 1000.0)


def render(recipe):
    """100 electrons a pixel; vignetting takes a tenth, each order adds one electron, read noise
    9 electrons² and clipping ends it at 101."""
    mean = torch.full((4, 4), 100.0 + recipe.orders)
    if recipe.vignetting:
        mean = mean * 0.9
    if recipe.clipping:
        mean = mean.clamp(max=101.0)
    return mean, torch.full((4, 4), 9.0 if recipe.read_noise else 4.0)


def toys(orders=2.0, vignetting=10.2):
    """Right bounds by default: an electron a pixel and order, a tenth of 102 electrons."""
    root = math.sqrt(PIXELS)
    return [
        Toy("vignetting", (Bound(vignetting * root), Bound()), sets={"vignetting": (0, True)}),
        Toy("orders", (Bound(orders * root), Bound(root), Bound()), (0, 1, 2),
            sets={"orders": (0, 1, 2)}),
        Toy("read noise", (Bound(variance=5 * root, sigma=root), Bound()),
            sets={"read_noise": (False, True)}),
    ]  # fmt: skip


def audited(made, forced, **options):
    plan = plan_effects(made, SITUATION, FLOOR, 0.0, forced)
    return audit(made, SITUATION, plan, render, **options)


OFF = {"vignetting": False, "orders": False, "read noise": False}


def test_bounds_that_hold_are_not_called_broken():
    rows = audited(toys(), OFF)
    assert not any(row.is_broken for row in rows)
    assert [row.effects for row in rows if len(row.effects) == 2] == [
        ("vignetting", "orders"), ("vignetting", "read noise"), ("orders", "read noise"),
    ]  # fmt: skip


def test_what_is_measured_is_what_changes_by_hand():
    rows = {(row.effects, row.others): row for row in audited(toys(), OFF)}
    # Others as planned: 100 to 90. Others at their finest: 102 to 91.8. Four is the root of 16.
    assert rows[("vignetting",), "as planned"].mean == pytest.approx(40.0, rel=1e-6)
    assert rows[("vignetting",), "finest"].mean == pytest.approx(40.8, rel=1e-6)
    assert rows[("read noise",), "as planned"].variance == pytest.approx(20.0)
    assert rows[("read noise",), "as planned"].sigma == pytest.approx(4.0)
    # Both: 100 to 0.9 * 102.
    assert rows[("vignetting", "orders"), "as planned"].mean == pytest.approx(4 * 8.2, rel=1e-5)


def test_a_bound_that_only_holds_with_the_others_off_is_found():
    """10 electrons is a tenth of 100, and not of the 102 that there are with all orders."""
    rows = audited(toys(vignetting=10.0), OFF)
    broken = [(row.effects, row.others) for row in rows if row.is_broken]
    assert broken == [(("vignetting",), "finest")]


def test_a_bound_that_is_too_small_is_found():
    rows = audited(toys(orders=1.9), OFF)
    assert (("orders",), "as planned") in [
        (row.effects, row.others) for row in rows if row.is_broken
    ]


def test_a_level_below_the_finest_is_tried_against_its_own_bound():
    rows = audited(toys(), {"orders": "level 1"})
    assert {row.effects for row in rows} == {("orders",)}
    assert rows[0].bound.mean == 4.0
    assert rows[0].mean == pytest.approx(3.6, rel=1e-5)


def test_each_picture_is_rendered_once():
    recipes = []

    def counted(recipe):
        recipes.append(recipe)
        return render(recipe)

    made = toys()
    plan = plan_effects(made, SITUATION, FLOOR, 0.0, OFF)
    audit(made, SITUATION, plan, counted)
    assert len(recipes) == len(set(recipes))


def test_what_an_effect_requires_is_switched_with_it():
    """Orders need vignetting here: it is on in both pictures, and its own change isn't counted."""
    made = toys()
    made[1].requires = ("vignetting",)
    rows = {(row.effects, row.others): row for row in audited(made, OFF)}
    assert rows[("orders",), "as planned"].mean == pytest.approx(4 * 0.9 * 2, rel=1e-5)
    # And with vignetting off at last, there can be no orders in either.
    assert rows[("vignetting",), "finest"].mean == pytest.approx(40.0, rel=1e-6)


def test_only_the_pairs_that_are_asked_for_are_tried():
    rows = audited(toys(), OFF, pairs=[("orders", "read noise")])
    assert [row.effects for row in rows if len(row.effects) == 2] == [("orders", "read noise")]


def test_a_pair_of_which_one_is_at_its_finest_is_refused():
    with pytest.raises(ValueError, match="has 'vignetting' at its finest, or not at all; audit "):
        audited(toys(), {"orders": False}, pairs=[("orders", "vignetting")])


@pytest.mark.parametrize(("refines", "held"), [((), False), (("read noise",), True)])
def test_what_an_effect_refines_may_change_with_it(refines, held):
    """Orders that bring read noise, whatever its own level."""
    made = toys()
    made[1].refines = refines

    def refining(recipe):
        return render(recipe.with_changes(read_noise=recipe.read_noise or recipe.orders > 0))

    plan = plan_effects(made, SITUATION, FLOOR, 0.0, OFF)
    rows = audit(made, SITUATION, plan, refining, pairs=[("vignetting", "orders")])
    found = {(row.effects, row.others): row for row in rows}
    assert found[("orders",), "as planned"].is_broken is not held
    assert found[("vignetting", "orders"), "as planned"].is_broken is not held
    assert not found[("orders",), "finest"].is_broken
