"""Effects that somebody forces, and plans that can't be."""

import math

import pytest
from planning_toys import SITUATION, Toy

from simulator.planning import Bound, MinimumNorms, plan_effects

FLOOR = MinimumNorms(1.0, 1.0, 1.0)
BOUNDS = (Bound(0.5), Bound(0.1), Bound())
WORKS = (0.0, 1.0, 2.0)


def pair():
    depth = Toy("depth", BOUNDS, WORKS)
    return [depth, Toy("hiding", BOUNDS, WORKS, requires=("depth",))]


def test_forced_off_is_told_as_forced_and_counts_in_the_error():
    plan = plan_effects([Toy("one", BOUNDS, WORKS)], SITUATION, FLOOR, 1e-3, {"one": False})
    assert plan["one"].forced
    assert plan["one"].level == "off"
    assert plan.relative_error == 0.5


def test_forced_on_is_the_finest_and_a_name_is_that_level():
    one = Toy("one", BOUNDS, WORKS)
    assert plan_effects([one], SITUATION, FLOOR, 10.0, {"one": True}).level("one") == 2
    assert plan_effects([one], SITUATION, FLOOR, 10.0, {"one": "level 1"}).level("one") == 1


def test_a_level_beyond_the_finest_of_a_situation_is_the_finest():
    class Coarse(Toy):
        def finest_level(self, s):
            return 1

    one = Coarse("one", (Bound(0.5), Bound(), Bound()), WORKS)
    assert plan_effects([one], SITUATION, FLOOR, 10.0, {"one": "level 2"}).level("one") == 1


def test_what_requires_one_that_is_forced_off_is_off_with_it():
    plan = plan_effects(pair(), SITUATION, FLOOR, 0.0, {"depth": False})
    assert plan.level("hiding") == 0
    assert plan.relative_error == 1.0


def test_forcing_on_what_requires_one_that_is_forced_off_is_refused():
    with pytest.raises(ValueError, match="'hiding' is forced on, and requires 'depth'"):
        plan_effects(pair(), SITUATION, FLOOR, 0.0, {"depth": False, "hiding": True})


def test_what_nothing_causes_is_in_no_plan_even_if_it_is_forced():
    absent = Toy("absent", BOUNDS, WORKS, there=False)
    plan = plan_effects([absent], SITUATION, FLOOR, 0.1, {"absent": True})
    assert plan.decisions == ()
    assert plan.level("absent") == 0


@pytest.mark.parametrize(
    ("forced", "message"),
    [
        ({"two": True}, "effect 'two' is unknown; choose among one"),
        ({"one": "level 9"}, "effect 'one' has no level 'level 9'; choose among off, level 1"),
    ],
)
def test_unknown_effects_and_levels_are_refused(forced, message):
    with pytest.raises(ValueError, match=message):
        plan_effects([Toy("one", BOUNDS, WORKS)], SITUATION, FLOOR, 0.1, forced)


@pytest.mark.parametrize("tol", [-0.1, math.nan, math.inf])
def test_a_tolerance_must_be_finite_and_not_negative(tol):
    with pytest.raises(ValueError, match=r"tol is .*; it must be finite and not negative"):
        plan_effects([Toy("one", BOUNDS, WORKS)], SITUATION, FLOOR, tol)
