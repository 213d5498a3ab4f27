"""What accounts tell beside what is true, and what was predicted beside what was spent.

The problems are random and fresh: no constant of the engine was fitted to them.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from figures import Figure
from figures import chains as random_chains
from figures import free_space_problems as free_space
from figures import problems as random_psfs
from labapp.accuracy.references.psf_problem import PSFProblem
from labapp.common.speed import machine_speed
from optics.accuracy import Account, Budget
from optics.camera import Camera
from optics.propagation import FreeSpace
from optics.psf import PSFOperator
from optics.threads import single_threaded

Operator = TypeVar("Operator", PSFOperator, FreeSpace)

_SEED = 20261124
_JUDGED_TERMS = 5e9
"""Products that the judge may sum for one problem: some seconds."""

_MOST_SECONDS = 4.0
"""Of planning and a call, predicted, beyond which a problem isn't asked."""

_FINE, _FINE_SECONDS = 0.03, 0.5
"""Largest error of the finer light over that of the light which it judges, and its longest time."""

_SMALL, _TOLD_SMALL = 1e-5, 1e-4
"""True errors up to the first are small; then no more than the second shall be told."""


@dataclass(frozen=True)
class Told:
    """An answer: its account's error and the true one, NaN if not judged; seconds predicted before
    it, by its account, and spent, planning included."""

    told: float
    true: float
    predicted: float
    accounted: float
    spent: float


Asked = Iterator[Callable[[Budget], Told | None]]
"""Problems to be asked within a budget; None where one is refused or would take too long."""


def _psfs(wanted: Callable[[PSFProblem], bool], source: Iterator[PSFProblem]) -> Asked:
    return (partial(_ask_psf, problem) for problem in source if wanted(problem))


def _ask_psf(problem: PSFProblem, budget: Budget) -> Told | None:
    def true_error(light: NDArray[Any]) -> float:
        judge = problem.build_reference(light)
        if judge.product_count > _JUDGED_TERMS:
            return math.nan
        sampled = judge.error(light)
        finer = _finer_light(problem, budget)
        if finer is None or judge.error(finer) > _FINE * sampled:
            return sampled
        return float(np.linalg.norm(light - finer) / np.linalg.norm(finer))

    plan = partial(problem.operator, problem.tol, calls=1, budget=budget)
    return _ask(plan, problem.light, true_error)


def _finer_light(problem: PSFProblem, budget: Budget) -> NDArray[Any] | None:
    """The light to a thousandth of the tolerance; None if that is refused or takes too long.

    The judge knows the exact light on some rows and columns only, so that its own estimate of an
    error scatters. It confirms this light there, which then is the truth on the whole window.
    """
    try:
        operator = problem.operator(max(1e-3 * problem.tol, 1e-9), calls=1, budget=budget)
        return problem.light(operator) if _seconds(operator.account) <= _FINE_SECONDS else None
    except ValueError:
        return None


def _ways(source: Iterator[free_space.Problem]) -> Asked:
    return (partial(_ask_way, problem) for problem in source)


def _ask_way(problem: free_space.Problem, budget: Budget) -> Told | None:
    field = problem.field

    def answer(operator: FreeSpace) -> NDArray[Any]:
        return np.asarray(operator(field).resolve_conj(), dtype=complex)

    def true_error(value: NDArray[Any]) -> float:
        judge = free_space.Judge(problem, value)
        return judge.error(value) if judge.cost <= free_space.JUDGED_COST else math.nan

    return _ask(partial(problem.operator, calls=1, budget=budget), answer, true_error)


def _ask(
    plan: Callable[[], Operator],
    answer: Callable[[Operator], NDArray[Any]],
    true_error: Callable[[NDArray[Any]], float],
) -> Told | None:
    """Plan, call and judge; what was predicted is what the account says before the call."""
    started = time.process_time()
    try:
        operator = plan()
        predicted = _seconds(operator.account)
        if predicted > _MOST_SECONDS:
            return None
        value = answer(operator)
    except ValueError:
        return None
    spent = time.process_time() - started
    account = operator.account
    return Told(account.error, true_error(value), predicted, _seconds(account), spent)


def _seconds(account: Account) -> float:
    """Predicted, of planning and one call."""
    return account.planning_predicted + account.cpu_predicted


def _kinds() -> dict[str, tuple[int, Asked]]:
    """How many problems of each kind are asked, and the problems."""

    def behind_panel(problem: PSFProblem) -> bool:
        return isinstance(problem.optics, Camera)

    lenses, panels = random_psfs.problems(_SEED), random_psfs.problems(_SEED + 1)
    return {
        "lens": (60, _psfs(lambda problem: not behind_panel(problem), lenses)),
        "panel": (60, _psfs(behind_panel, panels)),
        "chain": (40, _psfs(lambda problem: True, random_chains.chains(_SEED, 200))),
        "propagation": (100, _ways(free_space.problems(_SEED))),
    }


def answers(count: int, asked: Asked, budget: Budget) -> list[Told]:
    """The answers among so many problems; the first problem only warms the libraries up."""
    next(asked)(budget)
    found = (next(asked)(budget) for _ in range(count))
    return [one for one in found if one is not None]


def error_figure(kind: str, found: list[Told]) -> Figure:
    """How far errors are told above the true ones, and none below."""
    judged = [one for one in found if not math.isnan(one.true)]
    large = [one.true / one.told for one in judged if one.true > _SMALL]
    small = [one.told <= _TOLD_SMALL for one in judged if one.true <= _SMALL]
    below = sum(one.told < one.true for one in judged)
    ratio = statistics.median(large) if large else math.nan
    words = f"median 1/{1 / ratio:.2g} of {len(large)}" if large else "none is"
    return Figure(
        f"error told of a {kind}, calls=1: none below the true one; if that is above 1e-5, the "
        "true over the told; else told ≤ 1e-4",
        "0; ≥ 1/30; all",
        f"{below} of {len(judged)}; {words}; {sum(small)} of {len(small)}",
        below == 0 and (not large or ratio >= 1 / 30) and all(small),
    )


def cost_figure(kind: str, found: list[Told]) -> Figure:
    """How well the time of planning and a call is predicted."""
    ratios = [one.predicted / one.spent for one in found]
    inside = _share_of_good_prices(ratios)
    known = _share_of_good_prices([one.accounted / one.spent for one in found])
    low, middle, high = np.quantile(ratios, [0.05, 0.5, 0.95])
    return Figure(
        f"processor time predicted over spent, {kind}, planning and one call",
        "0.5 to 2 in 90 %",
        f"{100 * inside:.0f} % of {len(ratios)}; 5th percentile, median and 95th {low:.2f}, "
        f"{middle:.2f}, {high:.2f}; by the answer's account, which knows the pattern's light, "
        f"{100 * known:.0f} %",
        inside >= 0.9,
    )


def _share_of_good_prices(ratios: list[float]) -> float:
    return sum(0.5 <= ratio <= 2 for ratio in ratios) / len(ratios)


@single_threaded
def told_figures(folder: Path) -> list[Figure]:
    """All four kinds, one after the other."""
    budget = Budget(4 << 30, machine_speed())
    found: dict[str, list[Told]] = {
        kind: answers(count, asked, budget) for kind, (count, asked) in _kinds().items()
    }
    return [
        figure(kind, told) for figure in (error_figure, cost_figure) for kind, told in found.items()
    ]


MEASUREMENTS = {"told": told_figures}
