"""What answers were predicted to cost beside what they took, and whether fewer digits cost more.

The requests are random and fresh: no constant of a price was fitted to them.
"""

from __future__ import annotations

import functools
import gc
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from figures import Figure
from figures import chains as random_chains
from figures import free_space_problems as free_space
from figures import problems as random_psfs
from labapp.common.speed import machine_speed
from optics.accuracy import Budget
from optics.caching import ByteCache
from optics.camera import Camera, Panel
from optics.camera.pupil import pupil_amplitude
from optics.plane import Plane
from optics.threads import single_threaded

SEED = 20261129

_LEAST_SECONDS, _MOST_SECONDS = 0.02, 2.0
"""Spent, from which a price counts; and predicted, beyond which a request isn't asked."""

_PRICED, _COMPARED = 60, 12
"""Requests of each kind of which a price counts, and whose tolerances are compared."""

_FIRST_ANSWERS = 3
"""Answers that nothing was kept for, of which the median is what one takes."""

_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)

_DEARER = 1.1
"""Time of a tolerance over that of a finer one, beyond which the coarser one is called dearer."""

_REPEATS = 5
_COMPARED_SECONDS = 0.5
"""Predicted, beyond which a tolerance isn't compared."""


@dataclass(frozen=True)
class Request:
    """What is asked: plan() takes a tolerance and a budget, and returns an operator; answer() calls
    it."""

    tol: float
    plan: Callable[[float, Budget], Any]
    answer: Callable[[Any], Any]

    def first_answer(self, tol: float, budget: Budget) -> Any:
        return self.answer(self.plan(tol, budget))


@dataclass(frozen=True)
class Price:
    """Processor seconds of planning and a call, predicted before the call, and spent."""

    predicted: float
    spent: float

    @property
    def is_good(self) -> bool:
        return 0.5 <= self.predicted / self.spent <= 2


def _psf_request(problem: Any) -> Request:
    def plan(tol: float, budget: Budget) -> Any:
        return problem.operator(tol, calls=1, budget=budget)

    return Request(problem.tol, plan, problem.light)


def _lenses(seed: int) -> Iterator[Request]:
    for problem in random_psfs.problems(seed):
        if not isinstance(problem.optics, Camera):
            yield _psf_request(problem)


def _panels(seed: int) -> Iterator[Request]:
    """The same lenses with a panel in their plane: of 16 to 1100 pixels a side, 4 to 30 µm, 350 to
    1700 nm, half of the windows off the axis, half of their pixels integrated."""
    rng = np.random.default_rng(seed)
    for problem in random_psfs.problems(seed):
        rows, columns, side = (int(_log(rng, 16, most)) for most in (1100, 1100, 700))
        pitch = _log(rng, 1e-6, 20e-6)
        panel = Panel(
            (rows, columns),
            _log(rng, 4e-6, 30e-6),
            float(rng.uniform(0.6, 1.0)),
            unmodulated=float(rng.choice([0.0, 0.05])),
        )
        camera = Camera(panel, problem.lens)
        off = float(rng.choice([0.0, 1.5])) * rng.uniform(-0.5, 0.5, 2) * side * pitch
        if pupil_amplitude(camera).any():
            asked = replace(
                problem,
                optics=camera,
                phase=random_psfs.random_phase(rng, panel.shape),
                wavelength=float(rng.uniform(350e-9, 1700e-9)),
                pixels=Plane((side, int(_log(rng, 16, side + 1))), (pitch, pitch), tuple(off)),
                integrate=bool(rng.random() < 0.5),
            )
            yield _psf_request(asked)


_log = random_psfs.log_uniform


def _chains(seed: int) -> Iterator[Request]:
    return (_psf_request(problem) for problem in random_chains.chains(seed))


def _ways(seed: int) -> Iterator[Request]:
    return (_way_request(problem) for problem in free_space.problems(seed))


def _way_request(problem: free_space.Problem) -> Request:
    field = problem.field

    def plan(tol: float, budget: Budget) -> Any:
        return problem.operator(tol, calls=1, budget=budget)

    return Request(problem.tol, plan, lambda operator: operator(field))


KINDS: dict[str, Callable[[int], Iterator[Request]]] = {
    "lens": _lenses,
    "panel": _panels,
    "chain": _chains,
    "propagation": _ways,
}


def kept_results() -> list[Callable[[], None]]:
    """What empties each cache of the engine, so that a first answer finds nothing there.

    Caches without a limit stay: they hold rules that many requests share.
    """
    found: list[Callable[[], None]] = []
    for one in gc.get_objects():
        # The class is asked for by type(): some objects of libraries warn when they are touched.
        if type(one) is ByteCache:
            found.append(one.clear)
        elif type(one) is functools._lru_cache_wrapper and _is_limited_and_ours(one):
            found.append(one.cache_clear)
    return found


def _is_limited_and_ours(cached: Any) -> bool:
    return "optics." in cached.__module__ and cached.cache_parameters()["maxsize"] is not None


def price(request: Request, budget: Budget, forget: list[Callable[[], None]]) -> Price | None:
    """What a first answer was predicted to take and took; None if it's refused, or would be long.

    forget: what empties the caches.
    """
    spent, predicted = [], 0.0
    for _ in range(_FIRST_ANSWERS):
        for one in forget:
            one()
        started = time.process_time()
        try:
            operator = request.plan(request.tol, budget)
            predicted = _predicted(operator)
            if predicted > _MOST_SECONDS:
                return None
            request.answer(operator)
        except ValueError:
            return None
        spent.append(time.process_time() - started)
    return Price(predicted, statistics.median(spent))


def _predicted(operator: Any) -> float:
    """Seconds of planning and one call that an account tells."""
    return float(operator.account.planning_predicted + operator.account.cpu_predicted)


def priced(requests: Iterator[Request], budget: Budget, count: int) -> list[Price]:
    """The first prices that count; the first request only warms the libraries up."""
    price(next(requests), budget, [])
    forget = kept_results()
    found = (price(one, budget, forget) for one in requests)
    counted = (one for one in found if one is not None and one.spent >= _LEAST_SECONDS)
    return list(islice(counted, count))


def seconds_by_tolerance(
    request: Request, budget: Budget, forget: list[Callable[[], None]]
) -> dict[float, float]:
    """Least seconds of a first answer, by tolerance; without those that are refused, or would take
    too long. Other work of the machine only adds to a time."""
    spent: dict[float, list[float]] = {}
    for tol in _TOLERANCES:
        try:
            operator = request.plan(tol, budget)
            if _predicted(operator) > _COMPARED_SECONDS:
                continue
            request.answer(operator)
        except ValueError:
            continue
        spent[tol] = []
    for _ in range(_REPEATS):
        for tol, seconds in spent.items():
            for one in forget:
                one()
            started = time.process_time()
            request.first_answer(tol, budget)
            seconds.append(time.process_time() - started)
    return {tol: min(seconds) for tol, seconds in spent.items()}


def dearer_coarse(seconds: dict[float, float]) -> float:
    """The largest time of a tolerance over that of a finer one; 0 where none counts."""
    ratios = [0.0]
    for tol, spent in seconds.items():
        finer = [other for t, other in seconds.items() if t < tol]
        if finer and spent >= _LEAST_SECONDS:
            ratios.append(spent / min(finer))
    return max(ratios)


def price_figure(kind: str, found: list[Price]) -> Figure:
    """How well the time of planning and a call is predicted."""
    ratios = [one.predicted / one.spent for one in found]
    inside = sum(one.is_good for one in found) / len(found)
    low, middle, high = np.quantile(ratios, [0.05, 0.5, 0.95])
    return Figure(
        f"processor time predicted before the call over spent, {kind}, planning and one call, from "
        f"{1e3 * _LEAST_SECONDS:.0f} ms on",
        "0.5 to 2 in 90 %",
        f"{100 * inside:.0f} % of {len(found)}; 5th percentile, median and 95th {low:.2f}, "
        f"{middle:.2f}, {high:.2f}",
        inside >= 0.9,
    )


def order_figure(kind: str, found: list[float]) -> Figure:
    """How often a coarser tolerance is dearer than a finer one."""
    dearer = sum(one > _DEARER for one in found)
    return Figure(
        f"requests of which a coarser tolerance takes {_DEARER} times as long as a finer one, "
        f"{kind}, tolerances 1e-1 to 1e-5",
        "0",
        f"{dearer} of {len(found)}; at most {max(found):.2f} times",
        dearer == 0,
    )


@single_threaded
def price_figures(folder: Path) -> list[Figure]:
    """All four kinds, one after the other. folder: not used."""
    budget = Budget(speed=machine_speed())
    figures = []
    for kind, requests in KINDS.items():
        figures.append(price_figure(kind, priced(requests(SEED), budget, _PRICED)))
    forget = kept_results()
    for kind, requests in KINDS.items():
        compared = (seconds_by_tolerance(one, budget, forget) for one in requests(SEED + 1))
        counted = (one for one in compared if max(one.values(), default=0) >= _LEAST_SECONDS)
        ratios = [dearer_coarse(one) for one in islice(counted, _COMPARED)]
        figures.append(order_figure(kind, ratios))
    return figures


MEASUREMENTS = {"prices": price_figures}
