"""What a choice cost: the time of the chosen method over that of the fastest which would do."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from figures import Figure
from figures.stopwatch import processor_seconds
from optics.accuracy import Budget
from optics.psf import PSFOperator

CALLS = (1, 100)
"""How often a PSF is asked for: the choice is made for planning and all calls together."""

_REPEATS = 3
_LEAST_SECONDS = 0.005
"""Of a first answer, below which choices are about fractions of a millisecond."""

_TRIED = 4.0
"""Methods are tried whose first answer is predicted to take so many times that of the chosen."""


class Problem(Protocol):
    """A PSF that is asked for, and the names of the methods that may compute it."""

    @property
    def tol(self) -> float: ...

    @property
    def methods(self) -> tuple[str, ...]: ...

    def operator(self, tol: float, **settings: Any) -> PSFOperator: ...

    def light(self, operator: PSFOperator) -> NDArray[np.float64]: ...


@dataclass(frozen=True)
class Choice:
    """What a choice cost: over the fastest way by number of calls, and itself as a share of the
    time from the question to the first answer."""

    regrets: dict[int, float]
    choosing_share: float


def regret(times: Mapping[str, float]) -> float:
    """times: seconds by method, the chosen one first."""
    return next(iter(times.values())) / min(times.values())


def median_and_high(regrets: Sequence[float]) -> tuple[float, float]:
    """The median, and the 95th percentile."""
    return statistics.median(regrets), float(np.quantile(regrets, 0.95))


def psf_choices(source: Iterator[Problem], budget: Budget, most: float) -> Iterator[Choice]:
    """Without end: every method that keeps tol is timed beside the chosen one, planning included.

    most: seconds of a call, predicted, beyond which a problem is left out.
    """
    for problem in source:
        found = {calls: _costs(problem, budget, calls, most) for calls in CALLS}
        if not all(found.values()):
            continue
        first, _ = found[1]["chosen"]
        same = found[1].get(_method_of(problem, budget, 1))
        if first < _LEAST_SECONDS or same is None:
            continue
        regrets = {
            calls: regret({name: a + (calls - 1) * b for name, (a, b) in costs.items()})
            for calls, costs in found.items()
        }
        yield Choice(regrets, 1 - min(same[0] / first, 1.0))


def _method_of(problem: Problem, budget: Budget, calls: int) -> str:
    return str(problem.operator(problem.tol, budget=budget, calls=calls).engine.name)


def _costs(
    problem: Problem, budget: Budget, calls: int, most: float
) -> dict[str, tuple[float, float]]:
    """Seconds of the first answer and of a further call, by every way that keeps tol; the chosen
    one comes first. Empty for a problem that is refused or takes too long."""

    def first_answer(method: str | None) -> None:
        problem.light(problem.operator(problem.tol, budget=budget, calls=calls, method=method))

    ways: dict[str, str | None] = {}
    operators = {}
    longest = float("inf")
    for method in (None, *problem.methods):
        try:
            operator = problem.operator(problem.tol, budget=budget, calls=calls, method=method)
            account = operator.account
            if account.cpu_predicted > most:
                raise ValueError("too long")
            predicted = account.planning_predicted + calls * account.cpu_predicted
            if predicted > longest:
                continue
            started = time.process_time()
            problem.light(operator)
            spent = time.process_time() - started
        except ValueError:
            if method is None:
                return {}
            continue
        if method is None:
            longest = _TRIED * max(predicted, calls * spent)
        name = "chosen" if method is None else operator.engine.name
        ways.setdefault(name, method)
        operators.setdefault(name, operator)
    firsts = processor_seconds({n: partial(first_answer, m) for n, m in ways.items()}, _REPEATS)
    again = processor_seconds(
        {name: partial(problem.light, operator) for name, operator in operators.items()}, _REPEATS
    )
    return {name: (firsts[name], again[name]) for name in ways}


def choice_figures(what: str, choices: Sequence[Choice]) -> list[Figure]:
    """The regret for each number of calls, and what choosing takes."""
    found = []
    for calls in CALLS:
        median, high = median_and_high([one.regrets[calls] for one in choices])
        found.append(
            Figure(
                f"time of the chosen method over the fastest that meets tol, {what}, planning and "
                f"{calls} call{'s' if calls > 1 else ''}",
                "≤ 1.3 median",
                f"{median:.2f}, 95th percentile {high:.2f} of {len(choices)} over 5 ms",
                median <= 1.3,
            )
        )
    share = statistics.median(one.choosing_share for one in choices)
    found.append(
        Figure(
            f"choosing a method, {what}: share of the time to the first answer beyond what the "
            "method takes if it is named",
            "≤ 10 % median",
            f"{100 * share:.0f} % of {len(choices)}",
            share <= 0.1,
        )
    )
    return found
