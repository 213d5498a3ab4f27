"""Random scenes and benches: whether plans keep within their tolerance, and bounds hold."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from figures import TOLD, Figure
from figures.random_pictures import Case, TooLong, cases, deviation, everything
from labapp.common.console import print_message
from optics.threads import single_threaded
from simulator.effects.electron_bounds import without_clipping
from simulator.imaging import Imaging, PictureMoments
from simulator.planning import AuditResult, DecidedBy, EffectPlan, audit
from simulator.recipe import Recipe

T = TypeVar("T")

TOLERANCES = (1e-1, 1e-2, 1e-3)

_COUNT, _AUDITED, _PAIRS = 200, 60, 6
_SEED = 20261121
_MOST_WORK, _AUDITED_WORK = 1e9, 5e8
_AUDITED_TOL = 1e-1
"""At which most is left out, and so most can be put back."""

_PATIENCE = 120.0
"""Seconds of processor time for everything of one picture; those that take longer are told, and
others are drawn for them."""


@dataclass
class Tally:
    """What became of random pictures.

    worst: largest error over tolerance. wrong: in words, those beyond it. wrong_cases: the draws
    with any of these. left_out: effects below their finest, of all that were caused, over all
    plans. work: of plans over that of everything. cpu: seconds of processor time of each plan with
    its picture. planning_cpu: those of planning alone, of all together.
    """

    count: int = 0
    worst: float = 0.0
    wrong: list[str] = field(default_factory=list)
    wrong_cases: set[int] = field(default_factory=set)
    left_out: int = 0
    caused: int = 0
    work: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    planning_cpu: float = 0.0

    def add(self, case: Case, tol: float, truth: PictureMoments, decide_by: DecidedBy) -> None:
        """One more picture by a plan, against the one with everything on."""
        began = time.process_time()
        error, plan = deviation(case, tol, truth, decide_by)
        self.cpu.append(time.process_time() - began)
        self.planning_cpu += plan.planning_cpu
        self.worst = max(self.worst, error.worst / tol)
        if not error.worst <= tol:
            self.wrong_cases.add(case.number)
            self.wrong.append(
                f"tol {tol:g}: mean {error.mean:.1e}, variance {error.variance:.1e}, "
                f"sigma {error.sigma:.1e}; {case.words}"
            )
        below = sum(plan.level(name) < level for name, level in case.finest.items())
        self.left_out += below
        self.caused += len(case.finest)
        self.work.append(plan.work / plan.most_work if plan.most_work else 1.0)


def judged(drawn: Iterable[Case]) -> Iterator[tuple[Case, PictureMoments]]:
    """With the picture with everything on, where that doesn't take too long."""
    for case in drawn:
        try:
            yield case, everything(case, _PATIENCE)
        except TooLong:
            print_message(f"left out, for everything takes over {_PATIENCE:g} s: {case.words}")


def swept(
    drawn: Iterable[tuple[Case, PictureMoments]],
    tolerances: tuple[float, ...] = TOLERANCES,
    decide_by: DecidedBy = "bound",
) -> Tally:
    """Every case's picture by the plan for each tolerance, against the one with everything on."""
    (found,) = swept_by(drawn, (decide_by,), tolerances)
    return found


def swept_by(
    drawn: Iterable[tuple[Case, PictureMoments]],
    ways: tuple[DecidedBy, ...],
    tolerances: tuple[float, ...] = TOLERANCES,
) -> list[Tally]:
    """The same for each of several ways to decide; everything on is computed once for all."""
    tallies = [Tally() for _ in ways]
    for case, truth in drawn:
        for found, decide_by in zip(tallies, ways, strict=True):
            found.count += 1
            for tol in tolerances:
                found.add(case, tol, truth, decide_by)
    return tallies


def audited(
    case: Case, tol: float, pairs: int, seed: int, decide_by: DecidedBy = "bound"
) -> tuple[AuditResult, ...]:
    """Everything that a plan leaves out put back, singly and in some pairs drawn by chance."""
    s, imaging = case.at(tol), Imaging(tol, case.forced, decide_by=decide_by)
    plan = imaging.plan(s)

    def render(recipe: Recipe) -> tuple[torch.Tensor, torch.Tensor]:
        picture = imaging.picture_moments(s, without_clipping(s, recipe))
        return picture.mean, picture.variance

    return audit(case.effects, s, plan, render, pairs=_drawn_pairs(case, plan, pairs, seed))


def _drawn_pairs(case: Case, plan: EffectPlan, count: int, seed: int) -> list[tuple[str, str]]:
    known = {one.name for one in case.effects}
    below = [
        one.effect for one in plan.decisions if one.level != one.levels[-1] and one.effect in known
    ]
    every = list(itertools.combinations(below, 2))
    chosen = np.random.default_rng([seed, case.number]).permutation(len(every))[:count]
    return [every[k] for k in chosen]


def _told(drawn: Iterable[T], count: int) -> Iterator[T]:
    """They take long: every twentieth says so."""
    for number, one in enumerate(itertools.islice(drawn, count)):
        if number and not number % 20:
            print_message(f"{number} of {count} pictures")
        yield one


@single_threaded
def effects_figures(folder: Path) -> list[Figure]:
    """Two hundred pictures; sixty of them, the quickest, are audited."""
    found, estimated = swept_by(
        _told(judged(cases(_SEED, _MOST_WORK)), _COUNT), ("bound", "estimate")
    )
    for line in (*found.wrong, *estimated.wrong):
        print_message(line)
    singles, doubles, broken = 0, 0, []
    for case in _told(cases(_SEED + 1, _AUDITED_WORK), _AUDITED):
        for one in audited(case, _AUDITED_TOL, _PAIRS, _SEED):
            singles += len(one.effects) == 1
            doubles += len(one.effects) == 2
            if one.is_broken:
                share = f"{one.measured_over_bound:.2f} of the bound"
                broken.append(f"{' + '.join(one.effects)}: {share}; {case.words}")
    for line in broken:
        print_message(line)
    return [
        Figure(
            "200 random scenes and benches, tol 1e-1 / 1e-2 / 1e-3: picture and noise, planned",
            "within tol in all",
            f"of {found.count} {len(found.wrong)} beyond, worst {found.worst:.2f} tol; "
            f"{found.left_out} of {found.caused} effects left out or made coarser, median work "
            f"{statistics.median(found.work):.0%} of everything's",
            not found.wrong,
        ),
        Figure(
            "the same decided by estimates",
            "within tol in 198, none beyond 3 tol",
            f"of {estimated.count} {len(estimated.wrong_cases)} beyond, worst "
            f"{estimated.worst:.2f} tol; {estimated.left_out} of {estimated.caused} effects left "
            f"out or made coarser, median work {statistics.median(estimated.work):.0%}",
            len(estimated.wrong_cases) <= 0.01 * estimated.count and estimated.worst <= 3,
        ),
        Figure(
            "processor time of plans and pictures by estimates, over that by bounds",
            TOLD,
            f"median {_median_ratio(estimated.cpu, found.cpu):.2f}, sum "
            f"{sum(estimated.cpu) / sum(found.cpu):.2f}; planning is "
            f"{estimated.planning_cpu / sum(estimated.cpu):.0%} of it, by bounds "
            f"{found.planning_cpu / sum(found.cpu):.0%}",
            None,
        ),
        Figure(
            "bounds of effects that were left out of 60 such pictures, put back",
            "0 broken",
            f"{len(broken)} broken of {singles} single and {doubles} pairs",
            None if singles == 0 else not broken,
        ),
    ]


def _median_ratio(one: list[float], other: list[float]) -> float:
    return statistics.median(a / b for a, b in zip(one, other, strict=True))


MEASUREMENTS = {"effects": effects_figures}
