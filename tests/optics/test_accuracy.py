import math
from dataclasses import dataclass

import pytest

from optics.accuracy import (
    Account,
    Budget,
    CandidateMethod,
    DearerThanOthersError,
    ErrorEstimate,
    IterationOption,
    MachineSpeed,
    MethodChoice,
    ToleranceError,
    account_as_dict,
    best_within,
    cheapest_candidate,
    limit_planning_time,
    plan_budget,
    require_planning_time,
    unreachable_tolerance_error,
)


@dataclass
class Way(CandidateMethod):
    name: str
    bytes: int = 0
    cost: float = 0.0
    planning: float = 0.0

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self.cost * speed.fft

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return self.planning * speed.fft


QUICK, THRIFTY = Way("quick", 2_000_000_000, 1.0), Way("thrifty", 3_000_000, 9.0)


def test_the_cheapest_way_is_chosen():
    assert cheapest_candidate([THRIFTY, QUICK], Budget(), "it") is QUICK


def test_what_does_not_fit_in_memory_is_passed_over():
    assert cheapest_candidate([QUICK, THRIFTY], Budget(memory=4_000_000), "it") is THRIFTY


def test_if_nothing_fits_the_memory_of_the_thriftiest_is_named():
    with pytest.raises(
        ToleranceError,
        match=r"a hologram by thrifty needs 3 MB at least and 2 MB are allowed; allow more",
    ):
        cheapest_candidate([QUICK, THRIFTY], Budget(memory=2_000_000), "a hologram")


def test_an_account_adds_sampling_and_arithmetic_and_keeps_the_model_apart():
    account = Account(
        "way", "2x2", "float32", 1e-3, ErrorEstimate(0.5, "estimate"),
        ErrorEstimate(1e-4, "bound"), ErrorEstimate(2e-6, "measured"), 0.25, 10,
    )  # fmt: skip
    assert account.error == pytest.approx(1.02e-4)
    data = account_as_dict(account.with_cpu_spent(0.125))
    assert data["error_predicted"] == pytest.approx(1.02e-4)
    assert (data["error_sampling"], data["error_sampling_how"]) == (1e-4, "bound")
    assert (data["error_arithmetic"], data["error_arithmetic_how"]) == (2e-6, "measured")
    assert data["error_model"] == 0.5
    assert (data["cpu_predicted_s"], data["cpu_s"]) == (0.25, 0.125)
    assert account.cpu_spent is None


class Promising(Way):
    """A way that keeps no tolerance below its floor."""

    def __init__(self, name: str, cost: float, floor: float, tol: float, size: int = 1) -> None:
        super().__init__(name, size, cost, cost / 2)
        self.floor, self.tol = floor, tol

    def prepare(self) -> None:
        if self.tol < self.floor:
            raise unreachable_tolerance_error(self.tol, self.floor)


def promising(tol: float) -> MethodChoice[Promising]:
    def unfit() -> Promising:
        raise ValueError("it serves other questions")

    makers = [
        lambda: Promising("fine", 9.0, 1e-6, tol),
        lambda: Promising("coarse", 1.0, 1e-2, tol),
        lambda: Promising("vast", 0.1, 1e-9, tol, 1 << 40),
        unfit,
    ]
    return MethodChoice(makers, Budget(), "it")


@pytest.mark.parametrize(("tol", "names"), [(1e-1, ["coarse", "fine"]), (1e-3, ["fine"])])
def test_the_cheapest_that_keeps_its_promise_comes_first(tol, names):
    assert [one.name for one in promising(tol).prepared_candidates()] == names


def test_what_was_prepared_in_vain_is_priced():
    coarse = promising(1e-1)
    next(coarse.prepared_candidates())
    assert coarse.wasted_seconds == 0
    fine = promising(1e-3)
    next(fine.prepared_candidates())
    assert fine.wasted_seconds == 0.5 * MachineSpeed().fft


class Growing(Promising):
    """A way that proves to be dear while it is prepared."""

    def prepare(self) -> None:
        if 100 * MachineSpeed().fft > self.others_seconds:
            raise DearerThanOthersError(self.name)
        super().prepare()


@pytest.mark.parametrize(("floor", "names"), [(1e-6, ["fine", "grows"]), (1e-2, ["grows"])])
def test_what_proves_to_be_dearer_than_the_next_comes_last(floor, names):
    makers = [lambda: Growing("grows", 1.0, 0, 1e-3), lambda: Promising("fine", 9.0, floor, 1e-3)]
    choice = MethodChoice(makers, Budget(calls=1), "it")
    assert [one.name for one in choice.prepared_candidates()] == names
    assert choice.wasted_seconds >= 0.5 * MachineSpeed().fft


def test_a_refusal_names_the_least_tolerance_that_any_method_keeps():
    choice = promising(1e-8)
    assert not list(choice.prepared_candidates())
    refusal = choice.refusal(1e-8)
    assert isinstance(refusal, ToleranceError)
    assert refusal.floor == 1e-6
    assert "ask for tol 1e-06 or more" in str(refusal)


def test_what_takes_too_long_is_refused_with_the_way_to_have_it_all_the_same():
    choice = MethodChoice([lambda: QUICK, lambda: THRIFTY], Budget(seconds=1e-12), "it")
    assert choice.seconds == math.inf
    told = r"it by quick would take about \S+ s of .* 1e-12 s are allowed; allow more time, or"
    with pytest.raises(ToleranceError, match=told) as refused:
        raise choice.refusal(1e-3)
    assert "thrifty" not in str(refused.value)
    allowed = Budget(seconds=1.01 * refused.value.needed_seconds)
    assert MethodChoice([lambda: QUICK], allowed, "it").candidates == [QUICK]


def test_planning_that_takes_longer_than_predicted_ends_at_its_limit():
    def plan_for_ever() -> None:
        while True:
            require_planning_time("a star")

    told = r"a star took more than the 1e-06 s"
    with (
        limit_planning_time(1e-6),
        limit_planning_time(math.inf),
        pytest.raises(ToleranceError, match=told),
    ):
        plan_for_ever()
    require_planning_time("a star")


@pytest.mark.parametrize("wrong", [0, -1.0, math.nan])
def test_a_budget_of_nothing_is_refused(wrong):
    for name in ("memory", "seconds"):
        with pytest.raises(ValueError, match=f"{name} is {wrong}; give the .* above 0"):
            Budget(**{name: wrong})


def test_the_setting_that_gains_most_in_a_time_is_chosen():
    settings = [IterationOption("slow", 9, 5.0, 3.0), IterationOption("fast", 1, 1.0, 1.0)]
    assert best_within(6.0, settings).method == "slow"
    assert best_within(2.0, settings).method == "fast"
    with pytest.raises(ValueError, match=r"budget is 0\.5 s; the quickest, fast, takes about 1 s"):
        best_within(0.5, settings)


@pytest.mark.parametrize(("calls", "best"), [(1, "direct"), (4, "direct"), (6, "prepared")])
def test_the_method_is_chosen_for_the_time_of_planning_and_all_calls(calls, best):
    methods = [Way("prepared", cost=1.0, planning=5.0), Way("direct", cost=2.0)]
    assert cheapest_candidate(methods, Budget(calls=calls), "a picture").name == best


def test_a_budget_without_calls_is_refused():
    with pytest.raises(ValueError, match="calls is 0; at least 1 is needed"):
        Budget(calls=0)
    with pytest.raises(ValueError, match="calls is -3"):
        plan_budget(None, -3)
