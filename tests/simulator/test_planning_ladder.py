"""Properties of all plans, with effects of any bounds, works and demands."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_toys import SITUATION, Toy

from simulator.planning import Bound, Ladder, MinimumNorms, plan_effects

AMOUNTS = st.one_of(st.just(0.0), st.floats(1e-6, 10.0))
FLOORS = st.builds(MinimumNorms, *(st.floats(0.1, 10.0),) * 3)
TOLS = st.floats(0, 3.0)


@st.composite
def effects(draw):
    """Up to six, each requiring and coupled to some of those before it."""
    made = []
    for number in range(draw(st.integers(1, 6))):
        count = draw(st.integers(2, 4))
        columns = [sorted(draw(st.lists(AMOUNTS, min_size=count - 1, max_size=count - 1)),
                          reverse=True) for _ in range(4)]  # fmt: skip
        bounds = (*(Bound(*row) for row in zip(*columns, strict=True)), Bound())
        works = (0.0, *sorted(draw(st.lists(AMOUNTS, min_size=count - 1, max_size=count - 1))))
        before = st.sets(st.sampled_from([one.name for one in made])) if made else st.just(set())
        made.append(
            Toy(f"e{number}", bounds, works, tuple(draw(before)), tuple(draw(before)))
        )  # fmt: skip
    return made


@settings(max_examples=60, deadline=None)
@given(effects(), FLOORS, TOLS, TOLS)
def test_a_larger_tolerance_never_asks_for_more(made, floor, one, other):
    """No effect's level rises, and so no work does."""
    ladder = Ladder(made, SITUATION, floor)
    fine, coarse = ladder.levels(min(one, other)), ladder.levels(max(one, other))
    assert all(coarse[name] <= fine[name] for name in fine)
    assert ladder.work(coarse) <= ladder.work(fine) * (1 + 1e-12)


@settings(max_examples=60, deadline=None)
@given(effects(), FLOORS, TOLS)
def test_all_bounds_together_keep_within_the_tolerance(made, floor, tol):
    """Added up by hand, in each measure by itself."""
    levels = Ladder(made, SITUATION, floor).levels(tol)
    bounds = [one.bounds[levels[one.name]] for one in made]
    for measure, whole in (("mean", floor.mean), ("variance", floor.variance),
                           ("sigma", floor.sigma), ("shape", 1.0)):  # fmt: skip
        total = math.fsum(getattr(bound, measure) for bound in bounds)
        assert total / whole <= tol * (1 + 1e-9) + 1e-12


@settings(max_examples=60, deadline=None)
@given(effects(), FLOORS, TOLS)
def test_what_an_effect_requires_is_on_with_it(made, floor, tol):
    levels = Ladder(made, SITUATION, floor).levels(tol)
    for one in made:
        if levels[one.name]:
            assert all(levels[need] for need in one.requires)


@settings(max_examples=40, deadline=None)
@given(effects(), FLOORS)
def test_the_ladder_goes_from_everything_to_nothing(made, floor):
    """Steps only go down; at the end everything is off; what they save is what is left."""
    ladder = Ladder(made, SITUATION, floor)
    levels = dict(ladder.finest_levels)
    assert all(levels[one.name] == len(one.bounds) - 1 for one in made)
    for step in ladder.steps:
        assert step.to < levels[step.effect]
        levels[step.effect] = step.to
    assert not any(levels.values())
    assert ladder.work(levels) == 0


@settings(max_examples=40, deadline=None)
@given(effects(), FLOORS, TOLS, st.data())
def test_forced_effects_stay_and_spend_nothing(made, floor, tol, data):
    """What others do is what they do where the forced one has no bound and can't be moved."""
    one = data.draw(st.sampled_from(made))
    ladder = Ladder(made, SITUATION, floor, {one.name: len(one.bounds) - 1})
    levels = ladder.levels(tol)
    assert levels[one.name] == len(one.bounds) - 1
    spent = [other.bounds[levels[other.name]] for other in made if other is not one]
    assert math.fsum(bound.mean for bound in spent) <= floor.mean * tol * (1 + 1e-9) + 1e-12


def test_free_steps_come_before_all_others():
    free = Toy("free", (Bound(), Bound()), (0.0, 0.0))
    paid = Toy("paid", (Bound(1.0), Bound()), (0.0, 1e9))
    steps = Ladder([paid, free], SITUATION, MinimumNorms(1, 1, 1)).steps
    assert [step.effect for step in steps] == ["free", "paid"]
    assert Ladder([paid, free], SITUATION, MinimumNorms(1, 1, 1)).levels(0.0) == {
        "paid": 1,
        "free": 0,
    }


def test_the_one_that_saves_most_for_its_bound_goes_first():
    """10 operations for 0.1, 5 for 0.01: the second is five times better."""
    dear = Toy("dear", (Bound(0.1), Bound()), (0.0, 10.0))
    cheap = Toy("cheap", (Bound(0.01), Bound()), (0.0, 5.0))
    ladder = Ladder([dear, cheap], SITUATION, MinimumNorms(1, 1, 1))
    assert [step.effect for step in ladder.steps] == ["cheap", "dear"]
    assert ladder.levels(0.02) == {"dear": 1, "cheap": 0}
    assert ladder.levels(0.11) == {"dear": 0, "cheap": 0}


def test_a_dear_step_lets_cheaper_ones_go_first_up_to_half_its_price():
    """It saves a million times as much, but a tolerance below its price shall spare something."""
    dear = Toy("dear", (Bound(1.0), Bound()), (0.0, 1e9))
    cheap = [Toy(f"cheap{n}", (Bound(0.2), Bound()), (0.0, 10.0 - n)) for n in range(4)]
    ladder = Ladder([dear, *cheap], SITUATION, MinimumNorms(1, 1, 1))
    order = [step.effect for step in ladder.steps]
    assert order == ["cheap0", "cheap1", "dear", "cheap2", "cheap3"]
    assert ladder.levels(0.3) == {"dear": 1, "cheap0": 0, "cheap1": 1, "cheap2": 1, "cheap3": 1}


def test_what_each_frame_takes_counts_for_many():
    """A tenth of the work, but of every frame of a picture: it goes first."""

    class Drawn(Toy):
        is_per_frame = True

    once = Toy("once", (Bound(0.1), Bound()), (0.0, 10.0))
    drawn = Drawn("drawn", (Bound(0.1), Bound()), (0.0, 1.0))
    steps = Ladder([once, drawn], SITUATION, MinimumNorms(1, 1, 1)).steps
    assert [step.effect for step in steps] == ["drawn", "once"]
    assert [step.saved_work for step in steps] == [1.0, 10.0]


def test_levels_are_skipped_where_that_is_worth_more():
    """To level 1 saves 1 for 0.5; to level 0 saves 100 for 0.6."""
    one = Toy("one", (Bound(0.6), Bound(0.5), Bound()), (0.0, 99.0, 100.0))
    ladder = Ladder([one], SITUATION, MinimumNorms(1, 1, 1))
    assert [step.to for step in ladder.steps] == [0]
    assert ladder.levels(0.55) == {"one": 2}


def test_a_measure_of_which_there_is_nothing_is_never_given_up():
    """Variance where nothing is known to vary: any change is infinitely much."""
    noise = Toy("noise", (Bound(variance=1e-9), Bound()), (0.0, 1e9))
    assert Ladder([noise], SITUATION, MinimumNorms(1, 0, 0)).levels(1e6) == {"noise": 1}


def test_effects_are_asked_for_their_work_once_for_the_same_levels():
    asked = []

    class Counted(Toy):
        def added_operations(self, s, levels):
            asked.append((self.name, levels[self.name], *(levels[n] for n in self.coupled)))
            return super().added_operations(s, levels)

    made = [
        Counted(f"e{n}", (Bound(2.0), Bound(1.0), Bound()), (0.0, 1.0, 2.0),
                ("e0",) if n else ())
        for n in range(8)
    ]  # fmt: skip
    Ladder(made, SITUATION, MinimumNorms(1, 1, 1))
    assert len(asked) == len(set(asked))


def test_a_plan_tells_what_it_spends_and_saves():
    one = Toy("one", (Bound(0.05, how="proved: so"), Bound()), (0.0, 10.0))
    two = Toy("two", (Bound(0.5), Bound()), (0.0, 1.0))
    plan = plan_effects([one, two], SITUATION, MinimumNorms(1, 1, 1), 0.1)
    assert (plan.level("one"), plan.level("two")) == (0, 1)
    assert plan.relative_error == 0.05
    assert (plan.work, plan.most_work) == (1.0, 11.0)
    assert plan["one"].error.how == "proved: so"
    assert not plan.is_finest
    data = plan.as_data()
    assert [line["on"] for line in data["decisions"]] == [False, True]


def test_bounds_without_end_are_none_in_plain_data():
    one = Toy("one", (Bound(math.inf), Bound()), (0.0, 10.0))
    data = plan_effects([one], SITUATION, MinimumNorms(1, 1, 1), 0.1, {"one": False}).as_data()
    assert data["error"] is None
    assert data["decisions"][0]["error"]["mean"] is None
    assert data["decisions"][0]["relative"] is None


@pytest.mark.parametrize("value", [-1.0, math.nan])
@pytest.mark.parametrize("measure", ["mean", "variance", "sigma", "shape"])
def test_a_bound_below_nothing_is_refused(measure, value):
    with pytest.raises(ValueError, match=f"{measure} is .*; a bound is 0 or more"):
        Bound(**{measure: value})
